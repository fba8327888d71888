#pragma once
#include <chrono>
#include <condition_variable>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "daemon/link/detail/http_server.h"
#include "daemon/link/link_server.h"

namespace overfly::link {

// lat, lon, heading, pitch, fov in degrees, height in metres, w and h in pixels, photos a number of them.
// BadInput, with one sentence: something is missing, out of its range, or larger than the limits.
[[nodiscard]] Result<PreviewView> previewViewOf(const std::map<std::string, std::string>& query,
                                                const PreviewLimits& limits);

// Pictures from on board, as JPEG: single ones and streams (multipart/x-mixed-replace). One is drawn at a
// time; a stream gets its next picture only when it has taken the last one, and at most max_fps a second.
// Thread-safe; one thread of its own from the first stream on.
class Previews {
 public:
  static constexpr std::size_t kMostStreams = 4;

  // `wake` is called when a stream has something to send.
  Previews(LinkBackend& backend, std::function<void()> wake);
  ~Previews() { stop(); }
  Previews(const Previews&) = delete;
  Previews& operator=(const Previews&) = delete;

  // Unavailable: another picture is being drawn, or one was less than a frame's time ago.
  [[nodiscard]] Result<std::string> single(const Mission& mission, const PreviewView& view);
  // Begins with a picture, so that what cannot be drawn is an answer and not a broken stream.
  [[nodiscard]] Response stream(const Mission& mission, const PreviewView& view);
  void stop();

 private:
  class Stream;
  [[nodiscard]] Result<std::string> draw(const Mission& mission, const PreviewView& view);
  void serve(const std::stop_token& stop);

  LinkBackend& backend_;
  const std::function<void()> wake_;
  std::timed_mutex drawing_;                             // one picture at a time
  std::chrono::steady_clock::time_point last_single_{};  // guarded by drawing_
  std::mutex mutex_;
  std::condition_variable_any begun_;
  std::vector<std::weak_ptr<Stream>> streams_;
  bool closed_ = false;
  std::jthread thread_;  // last: uses everything above
};

}  // namespace overfly::link
