#pragma once
#include <chrono>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "config/error.h"

namespace overfly::pull {

struct TransferOptions {
  std::string token;          // sent as a bearer token; empty: none, or the URL holds it
  std::string ca_file;        // PEM to trust besides (a drone's own certificate); empty: the system's
  int connections = 4;        // at most, to the drone
  double connect_time_s = 4;  // a connection that takes longer is tried anew: its first packet may be lost
};

// How a transfer ended. `status` 0: no answer came; `problem` says why, without the URL, which may hold a
// token.
struct TransferEnd {
  long status = 0;
  bool whole = false;  // the answer's end was reached
  std::string problem;
  std::map<std::string, std::string> headers;  // lower-case names

  [[nodiscard]] std::string header(const std::string& name) const {
    const auto found = headers.find(name);
    return found == headers.end() ? std::string() : found->second;
  }
};

// A few HTTP GETs at once over kept connections (libcurl), all on the caller's thread.
class Transfers {
 public:
  explicit Transfers(TransferOptions options);
  ~Transfers();
  Transfers(const Transfers&) = delete;
  Transfers& operator=(const Transfers&) = delete;

  struct Call {
    std::string url;
    std::vector<std::string> headers;
    double stall_time_s = 6;  // without a byte: given up, its connection closed
    std::function<void(std::string_view)> data;
    std::function<void(const TransferEnd&)> end;  // once, from run(); may start further ones
  };
  void start(Call call);
  [[nodiscard]] std::size_t running() const;
  // Moves bytes and calls back for at most that long; returns early when something has happened.
  void run(std::chrono::milliseconds at_most);
  // run() returns at once. From any thread.
  void wake();

  [[nodiscard]] std::uint64_t bytes() const;        // of bodies, so far
  [[nodiscard]] std::uint64_t connections() const;  // made, so far

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// For the value of a query argument.
[[nodiscard]] std::string percentEncoded(std::string_view text);

}  // namespace overfly::pull
