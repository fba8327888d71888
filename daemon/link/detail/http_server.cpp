#include "daemon/link/detail/http_server.h"

#include <arpa/inet.h>
#include <microhttpd.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cctype>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <deque>
#include <fstream>
#include <mutex>
#include <set>
#include <sstream>
#include <thread>

#include "daemon/link/detail/token_bucket.h"

namespace overfly::link {
namespace {

constexpr std::size_t kBlock = 16 * 1024;   // asked of a body at once
constexpr std::size_t kStreamBlock = 4096;  // asked of a stream at once
constexpr std::size_t kLeastGrant = 1400;   // a starved client still gets about one packet at a time
constexpr std::size_t kHeaderBytes = 320;   // of a typical response head, charged to the rate limit

std::int64_t nowNs() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

std::string lower(std::string_view text) {
  std::string out(text);
  std::ranges::transform(out, out.begin(),
                         [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return out;
}

// What a connection is doing, and since when: what the clock thread judges slowness by.
enum class Phase { Header, Idle, Body, Working, Sending, Paced, Streaming };

struct Connection {
  int fd = -1;
  std::string address;  // of the client, without its port
  std::atomic<Phase> phase{Phase::Header};
  std::atomic<std::int64_t> since_ns{0};
  void enter(Phase next) {
    since_ns.store(nowNs(), std::memory_order_relaxed);
    phase.store(next, std::memory_order_relaxed);
  }
};

struct Exchange {
  Request request;
  Response response;
  bool ready = false;  // written by the worker before it resumes the connection
  bool too_large = false;
};

}  // namespace

Response Response::text(int status, std::string body, std::string type) {
  Response out;
  out.status = status;
  out.headers.emplace_back("Content-Type", std::move(type));
  out.body = std::make_shared<const std::string>(std::move(body));
  return out;
}

struct HttpServer::Impl {
  LinkOptions options;
  Gate gate;
  Handler handler;
  MHD_Daemon* daemon = nullptr;
  std::uint16_t bound_port = 0;
  std::string tls_key, tls_certificate;

  std::mutex queue_mutex;
  std::condition_variable queue_filled;
  struct Job {
    std::shared_ptr<Exchange> exchange;
    MHD_Connection* connection;
  };
  std::deque<Job> queue;
  bool queue_closed = false;
  std::vector<std::jthread> workers;

  // Suspended connections: those that wait for the rate limit, and streams without news.
  std::mutex wait_mutex;
  std::condition_variable wait_changed;
  std::deque<MHD_Connection*> paced;
  std::set<MHD_Connection*> quiet_streams;
  bool closing = false;
  TokenBucket bucket;  // guarded by wait_mutex
  std::atomic<double> max_kbps;
  std::jthread clock;

  std::mutex connections_mutex;
  std::set<Connection*> connections;

  std::atomic<std::uint64_t> requests{0}, refused{0}, dropped{0}, bytes{0}, streams{0};

  Impl(LinkOptions o, Gate g, Handler h)
      : options(std::move(o)),
        gate(std::move(g)),
        handler(std::move(h)),
        bucket(options.max_kbps * 125.0),
        max_kbps(options.max_kbps) {}

  // ---- callbacks of libmicrohttpd, all on its one thread ----

  static void onConnection(void* cls, MHD_Connection* connection, void** context,
                           MHD_ConnectionNotificationCode code) {
    auto& self = *static_cast<Impl*>(cls);
    if (code == MHD_CONNECTION_NOTIFY_STARTED) {
      auto* c = new Connection;
      c->fd = MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD)->connect_fd;
      c->address =
          addressOf(MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CLIENT_ADDRESS)->client_addr);
      c->enter(Phase::Header);
      self.configureSocket(c->fd);
      *context = c;
      const std::lock_guard lock(self.connections_mutex);
      self.connections.insert(c);
      const auto from_there = std::ranges::count(self.connections, c->address, &Connection::address);
      if (from_there > static_cast<std::ptrdiff_t>(self.options.max_connections_per_address))
        self.dropOldestWaiting(&c->address);
      else if (self.connections.size() > self.options.max_connections)
        self.dropOldestWaiting(nullptr);
    } else {
      auto* c = static_cast<Connection*>(*context);
      {
        const std::lock_guard lock(self.connections_mutex);
        self.connections.erase(c);
      }
      delete c;
      *context = nullptr;
    }
  }

  void configureSocket(int fd) const {
    // A client that acknowledges nothing is given up by the kernel; little unsent data waits in the socket,
    // so that what a reconnecting client has to ask for again is small.
    const auto timeout_ms = static_cast<unsigned>(options.stall_time_s * 1000);
    setsockopt(fd, IPPROTO_TCP, TCP_USER_TIMEOUT, &timeout_ms, sizeof timeout_ms);
    const int lowat = static_cast<int>(kBlock);
    setsockopt(fd, IPPROTO_TCP, TCP_NOTSENT_LOWAT, &lowat, sizeof lowat);
    // Takes a radio's losses for losses and not for a full queue; a kernel without it keeps its own choice.
    constexpr std::string_view kBbr = "bbr";
    setsockopt(fd, IPPROTO_TCP, TCP_CONGESTION, kBbr.data(), kBbr.size());
  }

  static std::string addressOf(const sockaddr* address) {
    char text[INET6_ADDRSTRLEN] = "";
    if (address && address->sa_family == AF_INET)
      inet_ntop(AF_INET, &reinterpret_cast<const sockaddr_in*>(address)->sin_addr, text, sizeof text);
    else if (address && address->sa_family == AF_INET6)
      inet_ntop(AF_INET6, &reinterpret_cast<const sockaddr_in6*>(address)->sin6_addr, text, sizeof text);
    return text;
  }

  // With every place taken (of one address, or of all), whoever has waited longest without a request makes
  // room, the newcomer itself when all others are being served: holding connections open must not lock
  // others out. connections_mutex is held.
  void dropOldestWaiting(const std::string* address) {
    Connection* oldest = nullptr;
    for (auto* c : connections) {
      if (address && c->address != *address) continue;
      const auto phase = c->phase.load(std::memory_order_relaxed);
      if (phase != Phase::Header && phase != Phase::Idle) continue;
      if (!oldest || c->since_ns < oldest->since_ns) oldest = c;
    }
    if (!oldest || oldest->since_ns == INT64_MAX) return;
    shutdown(oldest->fd, SHUT_RDWR);
    oldest->since_ns = INT64_MAX;  // not chosen twice
    ++dropped;
  }

  static Connection& contextOf(MHD_Connection* connection) {
    return *static_cast<Connection*>(
        MHD_get_connection_info(connection, MHD_CONNECTION_INFO_SOCKET_CONTEXT)->socket_context);
  }

  static MHD_Result onRequest(void* cls, MHD_Connection* connection, const char* url, const char* method,
                              const char* /*version*/, const char* upload, std::size_t* upload_size,
                              void** state) {
    return static_cast<Impl*>(cls)->request(connection, url, method, upload, upload_size, state);
  }

  MHD_Result request(MHD_Connection* connection, const char* url, const char* method, const char* upload,
                     std::size_t* upload_size, void** state) {
    auto& context = contextOf(connection);
    if (!*state) {
      ++requests;
      auto exchange = std::make_shared<Exchange>();
      fill(exchange->request, connection, url, method);
      *state = new std::shared_ptr<Exchange>(exchange);
      if (auto refusal = gate(exchange->request)) {
        ++refused;
        return queueResponse(connection, context, *refusal);
      }
      context.enter(Phase::Body);
      return MHD_YES;
    }
    auto& exchange = *static_cast<std::shared_ptr<Exchange>*>(*state);
    if (*upload_size > 0) {
      if (exchange->request.body.size() + *upload_size > options.max_body_bytes) {
        exchange->too_large = true;
        exchange->request.body.clear();
      } else if (!exchange->too_large) {
        exchange->request.body.append(upload, *upload_size);
      }
      *upload_size = 0;
      return MHD_YES;
    }
    if (exchange->too_large)
      return queueResponse(connection, context, Response::text(413, "The request's body is too large.\n"));
    if (exchange->ready) return queueResponse(connection, context, exchange->response);
    context.enter(Phase::Working);
    MHD_suspend_connection(connection);
    {
      const std::lock_guard lock(queue_mutex);
      if (!queue_closed) {
        queue.push_back({exchange, connection});
        queue_filled.notify_one();
        return MHD_YES;
      }
    }
    finish({exchange, connection}, Response::text(503, "The server is stopping.\n"));
    return MHD_YES;
  }

  static void fill(Request& request, MHD_Connection* connection, const char* url, const char* method) {
    const std::string_view m(method);
    request.method = m == "GET" || m == "HEAD" ? Method::Get
                     : m == "PUT"              ? Method::Put
                     : m == "DELETE"           ? Method::Delete
                     : m == "POST"             ? Method::Post
                                               : Method::Other;
    request.path = url;
    MHD_get_connection_values(
        connection, MHD_HEADER_KIND,
        [](void* to, MHD_ValueKind, const char* key, const char* value) {
          auto& headers = static_cast<Request*>(to)->headers;
          headers.insert_or_assign(lower(key), value ? value : "");
          return MHD_YES;
        },
        &request);
    MHD_get_connection_values(
        connection, MHD_GET_ARGUMENT_KIND,
        [](void* to, MHD_ValueKind, const char* key, const char* value) {
          auto& query = static_cast<Request*>(to)->query;
          if (query.size() < 64) query.insert_or_assign(key, value ? value : "");
          return MHD_YES;
        },
        &request);
  }

  static void onCompleted(void* /*cls*/, MHD_Connection* connection, void** state,
                          MHD_RequestTerminationCode) {
    delete static_cast<std::shared_ptr<Exchange>*>(*state);
    *state = nullptr;
    contextOf(connection).enter(Phase::Idle);
  }

  // ---- sending ----

  struct Sender {
    Impl* self;
    MHD_Connection* connection;
    Connection* context;
    std::shared_ptr<const std::string> body;
    std::shared_ptr<ResponseStream> stream;
    ~Sender() {
      if (stream) --self->streams;
    }
  };

  static ssize_t onRead(void* cls, std::uint64_t position, char* to, std::size_t capacity) {
    auto& sender = *static_cast<Sender*>(cls);
    auto& self = *sender.self;
    const std::lock_guard lock(self.wait_mutex);
    if (self.closing) return MHD_CONTENT_READER_END_WITH_ERROR;
    if (!sender.stream) {
      const auto& body = *sender.body;
      if (position >= body.size()) return MHD_CONTENT_READER_END_OF_STREAM;
      capacity = std::min<std::size_t>(capacity, body.size() - static_cast<std::size_t>(position));
    }
    const std::size_t granted = self.bucket.take(capacity, kLeastGrant, nowNs());
    if (granted == 0) {
      sender.context->enter(Phase::Paced);
      MHD_suspend_connection(sender.connection);
      self.paced.push_back(sender.connection);
      self.wait_changed.notify_one();
      return 0;
    }
    std::size_t sent = granted;
    if (sender.stream) {
      sent = sender.stream->read(to, granted);
      sender.context->enter(Phase::Streaming);
      if (sent < granted && !self.bucket.unlimited()) self.bucket.refund(granted - sent);
      if (sent == 0) {
        MHD_suspend_connection(sender.connection);
        self.quiet_streams.insert(sender.connection);
        return 0;
      }
    } else {
      std::memcpy(to, sender.body->data() + position, sent);
      sender.context->enter(Phase::Sending);
    }
    self.bytes += sent;
    return static_cast<ssize_t>(sent);
  }

  MHD_Result queueResponse(MHD_Connection* connection, Connection& context, const Response& response) {
    MHD_Response* out = nullptr;
    const bool empty = !response.stream && (!response.body || response.body->empty());
    if (empty) {
      out = MHD_create_response_from_buffer(0, nullptr, MHD_RESPMEM_PERSISTENT);
    } else {
      auto* sender = new Sender{this, connection, &context, response.body, response.stream};
      if (response.stream) ++streams;
      out = MHD_create_response_from_callback(response.stream ? MHD_SIZE_UNKNOWN : response.body->size(),
                                              response.stream ? kStreamBlock : kBlock, &onRead, sender,
                                              [](void* p) { delete static_cast<Sender*>(p); });
      if (!out) delete sender;
    }
    if (!out) return MHD_NO;
    for (const auto& [name, value] : response.headers)
      MHD_add_response_header(out, name.c_str(), value.c_str());
    MHD_add_response_header(out, "X-Content-Type-Options", "nosniff");
    MHD_add_response_header(out, "Referrer-Policy", "no-referrer");
    {
      const std::lock_guard lock(wait_mutex);
      bucket.charge(kHeaderBytes, nowNs());
    }
    bytes += kHeaderBytes;
    context.enter(Phase::Sending);
    const auto result = MHD_queue_response(connection, static_cast<unsigned>(response.status), out);
    MHD_destroy_response(out);
    return result;
  }

  // ---- workers and clock ----

  static void finish(const Job& job, Response response) {
    job.exchange->response = std::move(response);
    job.exchange->ready = true;
    MHD_resume_connection(job.connection);
  }

  void work() {
    for (;;) {
      Job job;
      {
        std::unique_lock lock(queue_mutex);
        queue_filled.wait(lock, [&] { return !queue.empty() || queue_closed; });
        if (queue.empty()) return;
        job = std::move(queue.front());
        queue.pop_front();
        if (queue_closed) {
          lock.unlock();
          finish(job, Response::text(503, "The server is stopping.\n"));
          continue;
        }
      }
      finish(job, handler(job.exchange->request));
    }
  }

  void tick(const std::stop_token& stop) {
    using namespace std::chrono_literals;
    auto next_reap = std::chrono::steady_clock::now();
    while (!stop.stop_requested()) {
      {
        std::unique_lock lock(wait_mutex);
        wait_changed.wait_for(lock, paced.empty() ? 200ms : 10ms, [&] { return closing; });
        if (closing) return;
        // as many as the bucket can serve now; the others keep their place
        auto available = bucket.available(nowNs());
        while (!paced.empty() && available >= static_cast<double>(kLeastGrant)) {
          MHD_resume_connection(paced.front());
          paced.pop_front();
          available -= static_cast<double>(kLeastGrant);
        }
      }
      if (const auto now = std::chrono::steady_clock::now(); now >= next_reap) {
        next_reap = now + 200ms;
        reap();
      }
    }
  }

  void reap() {
    const auto now = nowNs();
    const std::lock_guard lock(connections_mutex);
    for (auto* c : connections) {
      double limit_s = 0;
      switch (c->phase.load(std::memory_order_relaxed)) {
        case Phase::Header:
          limit_s = options.header_time_s;
          break;
        case Phase::Body:
          limit_s = options.header_time_s;
          break;
        case Phase::Idle:
          limit_s = options.idle_time_s;
          break;
        case Phase::Sending:
          limit_s = options.stall_time_s;
          break;
        case Phase::Working:
        case Phase::Paced:
        case Phase::Streaming:
          continue;  // waits for us, not for the client
      }
      const auto since = c->since_ns.load(std::memory_order_relaxed);
      if (since == INT64_MAX || static_cast<double>(now - since) * 1e-9 <= limit_s) continue;
      shutdown(c->fd, SHUT_RDWR);
      c->since_ns = INT64_MAX;
      ++dropped;
    }
  }
};

HttpServer::HttpServer(LinkOptions options, Gate gate, Handler handler)
    : impl_(std::make_unique<Impl>(std::move(options), std::move(gate), std::move(handler))) {}

HttpServer::~HttpServer() { stop(); }

namespace {

Result<std::string> readWhole(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  if (!in || text.str().empty()) return fail(ErrorCode::BadSettings, "cannot read " + path + " (link.tls)");
  return text.str();
}

// One file descriptor a connection, and what the rest of the process needs.
void raiseFileLimit(unsigned connections) {
  rlimit limit{};
  if (getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
  const rlim_t wanted = std::min<rlim_t>(limit.rlim_max, connections + 512);
  if (limit.rlim_cur >= wanted) return;
  limit.rlim_cur = wanted;
  setrlimit(RLIMIT_NOFILE, &limit);
}

}  // namespace

Result<void> HttpServer::start() {
  auto& self = *impl_;
  auto& options = self.options;
  sockaddr_storage address{};
  unsigned flags = MHD_USE_EPOLL_INTERNAL_THREAD | MHD_ALLOW_SUSPEND_RESUME;
  auto* v4 = reinterpret_cast<sockaddr_in*>(&address);
  auto* v6 = reinterpret_cast<sockaddr_in6*>(&address);
  if (inet_pton(AF_INET, options.address.c_str(), &v4->sin_addr) == 1) {
    v4->sin_family = AF_INET;
    v4->sin_port = htons(options.port);
  } else if (inet_pton(AF_INET6, options.address.c_str(), &v6->sin6_addr) == 1) {
    v6->sin6_family = AF_INET6;
    v6->sin6_port = htons(options.port);
    flags |= MHD_USE_IPv6 | MHD_USE_DUAL_STACK;
  } else {
    return fail(ErrorCode::BadSettings, "link.address \"" + options.address + "\" is not an IP address");
  }
  raiseFileLimit(options.max_connections);

  std::vector<MHD_OptionItem> extra;
  if (!options.tls_certificate_file.empty()) {
    auto certificate = readWhole(options.tls_certificate_file);
    if (!certificate) return tl::unexpected(certificate.error());
    auto key = readWhole(options.tls_key_file);
    if (!key) return tl::unexpected(key.error());
    self.tls_certificate = std::move(*certificate);
    self.tls_key = std::move(*key);
    flags |= MHD_USE_TLS;
    extra.push_back({MHD_OPTION_HTTPS_MEM_CERT, 0, self.tls_certificate.data()});
    extra.push_back({MHD_OPTION_HTTPS_MEM_KEY, 0, self.tls_key.data()});
  }
  extra.push_back({MHD_OPTION_END, 0, nullptr});
  // Above our own limit, so that the one too many can be let in and the one that idles be put out.
  const unsigned hard_limit = options.max_connections + 64;
  self.daemon = MHD_start_daemon(flags, options.port, nullptr, nullptr, &Impl::onRequest, &self,  //
                                 MHD_OPTION_SOCK_ADDR, reinterpret_cast<sockaddr*>(&address),     //
                                 MHD_OPTION_CONNECTION_LIMIT, hard_limit,                         //
                                 MHD_OPTION_CONNECTION_MEMORY_LIMIT,
                                 static_cast<std::size_t>(options.max_request_header_bytes),  //
                                 MHD_OPTION_NOTIFY_CONNECTION, &Impl::onConnection, &self,    //
                                 MHD_OPTION_NOTIFY_COMPLETED, &Impl::onCompleted, &self,      //
                                 MHD_OPTION_LISTENING_ADDRESS_REUSE, 1u, MHD_OPTION_LISTEN_BACKLOG_SIZE, 256u,
                                 MHD_OPTION_ARRAY, extra.data(), MHD_OPTION_END);
  if (!self.daemon)
    return fail(ErrorCode::BadSettings, "cannot listen on " + options.address + " port " +
                                            std::to_string(options.port) +
                                            ": is the port taken, or the TLS certificate or key unusable?");
  const auto* info = MHD_get_daemon_info(self.daemon, MHD_DAEMON_INFO_BIND_PORT);
  self.bound_port = info ? info->port : options.port;
  for (unsigned i = 0; i < std::max(1u, options.workers); ++i)
    self.workers.emplace_back([&self] { self.work(); });
  self.clock = std::jthread([&self](const std::stop_token& stop) { self.tick(stop); });
  return {};
}

void HttpServer::stop() {
  auto& self = *impl_;
  if (!self.daemon) return;
  if (const int fd = MHD_quiesce_daemon(self.daemon); fd >= 0) close(fd);
  {
    const std::lock_guard lock(self.queue_mutex);
    self.queue_closed = true;
    self.queue_filled.notify_all();
  }
  self.workers.clear();
  {
    const std::lock_guard lock(self.wait_mutex);
    self.closing = true;
    for (auto* c : self.paced) MHD_resume_connection(c);
    for (auto* c : self.quiet_streams) MHD_resume_connection(c);
    self.paced.clear();
    self.quiet_streams.clear();
    self.wait_changed.notify_all();
  }
  self.clock = {};
  MHD_stop_daemon(self.daemon);
  self.daemon = nullptr;
}

std::uint16_t HttpServer::port() const { return impl_->bound_port; }

void HttpServer::wakeStreams() {
  auto& self = *impl_;
  const std::lock_guard lock(self.wait_mutex);
  for (auto* c : self.quiet_streams) MHD_resume_connection(c);
  self.quiet_streams.clear();
}

void HttpServer::setMaxKbps(double kbps) {
  impl_->max_kbps = kbps;
  const std::lock_guard lock(impl_->wait_mutex);
  impl_->bucket.setRate(kbps * 125.0);
}

HttpCounters HttpServer::counters() const {
  auto& self = *impl_;
  HttpCounters out{self.requests, self.refused, self.dropped, self.bytes, 0, self.streams, self.max_kbps};
  const std::lock_guard lock(self.connections_mutex);
  out.connections = self.connections.size();
  return out;
}

}  // namespace overfly::link
