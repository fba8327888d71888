#pragma once
#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <random>
#include <string>
#include <thread>

namespace overfly::test {

// A network namespace of its own with one TUN device, whose packets come to this process. Needs CAP_SYS_ADMIN
// and /dev/net/tun; make() is nullopt without.
class Namespace {
 public:
  static std::optional<Namespace> make(const std::string& address);
  Namespace(Namespace&& other) noexcept;
  Namespace& operator=(Namespace&&) = delete;
  ~Namespace();

  // Runs `work` in there, on a thread of its own: sockets and programs that it makes stay there.
  void run(const std::function<void()>& work) const;
  [[nodiscard]] int device() const { return device_; }

 private:
  Namespace(int netns, int device) : netns_(netns), device_(device) {}
  int netns_ = -1, device_ = -1;
};

struct LinkQuality {
  double loss = 0.05;           // of packets, each way, independent
  double bits_per_s = 200'000;  // of IP packets, each way
  double delay_s = 0.15;        // each way, beside the waiting for the rate
  double queue_s = 0.5;         // a packet that would wait longer than this is dropped, as radios do
  std::uint64_t seed = 1;
};

// The radio: carries packets between two namespaces, and loses, delays and limits them; what a proxy of TCP
// cannot do.
class LossyLink {
 public:
  LossyLink(const Namespace& drone, const Namespace& ground, const LinkQuality& quality);
  ~LossyLink() = default;

  void blackout(bool dark) { dark_ = dark; }
  // IP packets that arrived on the ground, bytes with heads.
  [[nodiscard]] std::uint64_t deliveredToGround() const { return to_ground_; }
  [[nodiscard]] std::uint64_t lostPackets() const { return lost_; }

 private:
  void carry(const std::stop_token& stop, int from, int to, std::uint64_t seed,
             std::atomic<std::uint64_t>& bytes);

  const LinkQuality quality_;
  std::atomic<bool> dark_{false};
  std::atomic<std::uint64_t> to_ground_{0}, to_drone_{0}, lost_{0};
  std::jthread down_, up_;  // after what they use
};

}  // namespace overfly::test
