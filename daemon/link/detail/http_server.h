#pragma once
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "config/error.h"
#include "daemon/link/link_options.h"

namespace overfly::link {

enum class Method { Get, Put, Delete, Post, Other };

// One request as the routes see it. Header names are lower case; `path` is percent-decoded and has lost its
// /t/TOKEN prefix (`prefix` keeps it, for documents that name their own URLs).
struct Request {
  Method method = Method::Get;
  std::string path;
  std::string prefix;
  std::map<std::string, std::string> query;
  std::map<std::string, std::string> headers;
  std::string body;

  [[nodiscard]] std::string header(const std::string& name) const {
    const auto it = headers.find(name);
    return it == headers.end() ? std::string() : it->second;
  }
  [[nodiscard]] std::optional<std::string> arg(const std::string& name) const {
    const auto it = query.find(name);
    if (it == query.end()) return std::nullopt;
    return it->second;
  }
};

// A response without end (events). read() is called on the server's thread, never blocks, and returns the
// bytes it copied; 0: nothing now, it is called again after HttpServer::wake(). Thread rule of an
// implementation: read() races with whoever feeds it and has to lock.
class ResponseStream {
 public:
  virtual ~ResponseStream() = default;
  [[nodiscard]] virtual std::size_t read(char* to, std::size_t capacity) = 0;
};

struct Response {
  int status = 200;
  std::vector<std::pair<std::string, std::string>> headers;
  std::shared_ptr<const std::string> body;
  std::shared_ptr<ResponseStream> stream;  // instead of a body

  [[nodiscard]] static Response text(int status, std::string body,
                                     std::string type = "text/plain; charset=utf-8");
  [[nodiscard]] static Response json(std::string body, int status = 200) {
    return text(status, std::move(body), "application/json");
  }
};

struct HttpCounters {
  std::uint64_t requests = 0, refused = 0, dropped = 0, bytes = 0;
  std::uint64_t connections = 0, streams = 0;  // now open
  double max_kbps = 0;                         // the cap now
};

// Event-driven HTTP/1.1 over libmicrohttpd: one epoll thread moves bytes, a few workers make responses, one
// clock thread refills the rate limit and drops connections that are too slow. However many clients there
// are, there are no more threads. Knows nothing of maps.
//
// Thread rules: the handler runs on a worker, several at once. start() once; stop() from any thread but a
// worker, also run by the destructor.
class HttpServer {
 public:
  using Handler = std::function<Response(const Request&)>;
  // Decides on a request before any work is done for it (on the server's thread: must not block); a value is
  // the refusal. May rewrite path and prefix.
  using Gate = std::function<std::optional<Response>(Request&)>;

  HttpServer(LinkOptions options, Gate gate, Handler handler);
  ~HttpServer();
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;

  [[nodiscard]] Result<void> start();
  void stop();
  [[nodiscard]] std::uint16_t port() const;
  // Streams have news: their read() is called again. Thread-safe, cheap.
  void wakeStreams();
  // The cap from now on; 0: none. Thread-safe.
  void setMaxKbps(double kbps);
  [[nodiscard]] HttpCounters counters() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace overfly::link
