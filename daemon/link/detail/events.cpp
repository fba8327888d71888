#include "daemon/link/detail/events.h"

#include <algorithm>
#include <cstring>

namespace overfly::link {

class EventHub::Stream final : public ResponseStream {
 public:
  Stream(EventHub& hub, std::string first, bool with_status, std::uint64_t next)
      : hub_(hub), pending_(std::move(first)), with_status_(with_status), next_(next) {}
  ~Stream() override {
    if (!with_status_) return;
    const std::lock_guard lock(hub_.mutex_);
    --hub_.status_streams_;
  }
  Stream(const Stream&) = delete;
  Stream& operator=(const Stream&) = delete;

  std::size_t read(char* to, std::size_t capacity) override {
    if (sent_ == pending_.size()) refill(capacity);
    const auto size = std::min(capacity, pending_.size() - sent_);
    std::memcpy(to, pending_.data() + sent_, size);
    sent_ += size;
    return size;
  }

 private:
  void refill(std::size_t capacity) {
    pending_.clear();
    sent_ = 0;
    const std::lock_guard lock(hub_.mutex_);
    if (hub_.ring_.empty()) return;
    const auto oldest = hub_.ring_.front().sequence;
    if (next_ < oldest) {
      pending_ = format("resync", "", "{}");
      next_ = oldest;
    }
    for (auto i = static_cast<std::size_t>(next_ - oldest);
         i < hub_.ring_.size() && pending_.size() < capacity; ++i) {
      const auto& entry = hub_.ring_[i];
      next_ = entry.sequence + 1;
      if (entry.kind != Kind::Status || with_status_) pending_ += entry.text;
    }
  }

  EventHub& hub_;
  std::string pending_;
  std::size_t sent_ = 0;
  const bool with_status_;
  std::uint64_t next_;
};

std::string EventHub::format(const std::string& event, const std::string& id, const std::string& data) {
  std::string out;
  if (!id.empty()) out += "id: " + id + "\n";
  out += "event: " + event + "\ndata: " + data + "\n\n";
  return out;
}

void EventHub::publish(Kind kind, const std::string& event, const std::string& id, const std::string& data) {
  const std::lock_guard lock(mutex_);
  ring_.push_back({next_++, kind, kind == Kind::Beat ? ":\n\n" : format(event, id, data)});
  used_bytes_ += ring_.back().text.size();
  while (used_bytes_ > ring_bytes_ && ring_.size() > 1) {
    used_bytes_ -= ring_.front().text.size();
    ring_.pop_front();
  }
}

void EventHub::beat() { publish(Kind::Beat, {}, {}, {}); }

EventHub::Position EventHub::position() const {
  const std::lock_guard lock(mutex_);
  return {next_};
}

std::shared_ptr<ResponseStream> EventHub::subscribe(std::string first, bool with_status) {
  return subscribe(std::move(first), with_status, position());
}

std::shared_ptr<ResponseStream> EventHub::subscribe(std::string first, bool with_status, Position from) {
  if (with_status) {
    const std::lock_guard lock(mutex_);
    ++status_streams_;
  }
  return std::make_shared<Stream>(*this, std::move(first), with_status, from.sequence);
}

bool EventHub::statusWanted() const {
  const std::lock_guard lock(mutex_);
  return status_streams_ > 0;
}

}  // namespace overfly::link
