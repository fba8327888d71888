#include "daemon/link/link_server.h"

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <thread>

#include "daemon/link/detail/auth.h"
#include "daemon/link/detail/events.h"
#include "daemon/link/detail/http_server.h"
#include "daemon/link/detail/routes.h"

namespace overfly::link {

struct LinkServer::Impl {
  LinkOptions options;
  std::shared_ptr<LinkBackend> backend;
  EventHub events;
  std::optional<Access> access;
  std::unique_ptr<Routes> routes;
  std::unique_ptr<HttpServer> server;

  std::mutex mutex;
  std::condition_variable_any woken;
  bool changed = false;
  std::jthread watcher;

  void watch(const std::stop_token& stop) {
    using Clock = std::chrono::steady_clock;
    using namespace std::chrono_literals;
    auto last_sent = Clock::now(), last_status = last_sent;
    const auto heartbeat = std::chrono::duration<double>(options.event_heartbeat_s);
    while (!stop.stop_requested()) {
      {
        std::unique_lock lock(mutex);
        woken.wait_for(lock, stop, 200ms, [&] { return changed; });
        changed = false;
      }
      const auto before = events.position().sequence;
      routes->look();
      const auto now = Clock::now();
      if (now - last_status >= 1s) {
        routes->publishStatus();
        last_status = now;
      }
      if (now - last_sent >= heartbeat) events.beat();
      if (events.position().sequence == before) continue;
      last_sent = now;
      server->wakeStreams();
    }
  }
};

LinkServer::LinkServer(LinkOptions options, std::shared_ptr<LinkBackend> backend)
    : impl_(std::make_unique<Impl>()) {
  impl_->options = std::move(options);
  impl_->backend = std::move(backend);
}

LinkServer::~LinkServer() { stop(); }

Result<void> LinkServer::start() {
  auto& self = *impl_;
  auto access = Access::load(self.options);
  if (!access) return tl::unexpected(access.error());
  self.access = std::move(*access);
  const bool tls = !self.options.tls_certificate_file.empty();
  self.routes = std::make_unique<Routes>(
      self.options, self.backend, self.events, tls, self.access->hasToken(),
      [&self] { return self.server->counters(); },
      [this] {
        const auto& address = impl_->options.address;
        return (address.find(':') == std::string::npos ? address : "[" + address + "]") + ":" +
               std::to_string(port());
      },
      [&self] { self.server->wakeStreams(); });
  self.server = std::make_unique<HttpServer>(
      self.options, [&self](Request& request) { return self.access->refuse(request); },
      [&self](const Request& request) {
        auto response = self.routes->answer(request);
        self.access->addCors(request, response);
        return response;
      });
  if (auto started = self.server->start(); !started) return started;
  self.watcher = std::jthread([&self](const std::stop_token& stop) { self.watch(stop); });
  return {};
}

void LinkServer::stop() {
  auto& self = *impl_;
  self.watcher = {};
  if (self.routes) self.routes->stopPreviews();
  if (self.server) self.server->stop();
}

std::uint16_t LinkServer::port() const { return impl_->server ? impl_->server->port() : impl_->options.port; }

std::string LinkServer::url() const {
  const auto& self = *impl_;
  auto host = self.options.address;
  if (host == "0.0.0.0" || host == "::") host = "127.0.0.1";
  if (host.find(':') != std::string::npos) host = "[" + host + "]";
  const auto token = self.access ? self.access->tokenPath() : std::string();
  return std::string(self.options.tls_certificate_file.empty() ? "http://" : "https://") + host + ":" +
         std::to_string(port()) + token + "/";
}

void LinkServer::mapChanged() {
  const std::lock_guard lock(impl_->mutex);
  impl_->changed = true;
  impl_->woken.notify_one();
}

void LinkServer::setMaxKbps(double kbps) {
  impl_->options.max_kbps = kbps;
  if (impl_->server) impl_->server->setMaxKbps(kbps);
}

namespace {

class FinishedMaps final : public LinkBackend {
 public:
  explicit FinishedMaps(std::vector<Mission> missions) : missions_(std::move(missions)) {
    for (auto& mission : missions_) mission.current = false;
    if (!missions_.empty()) missions_.front().current = true;
  }
  [[nodiscard]] std::vector<Mission> missions() const override { return missions_; }

 private:
  std::vector<Mission> missions_;
};

}  // namespace

std::shared_ptr<LinkBackend> showMaps(std::vector<Mission> missions) {
  return std::make_shared<FinishedMaps>(std::move(missions));
}

}  // namespace overfly::link
