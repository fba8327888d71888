#include "daemon/link/detail/previews.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "daemon/link/detail/image_codec.h"
#include "daemon/link/detail/parse.h"

namespace overfly::link {
namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

constexpr const char* kBoundary = "overfly-picture";
constexpr int kLeastSide = 16;

Clock::duration frameTime(const PreviewLimits& limits) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1 / limits.max_fps));
}

}  // namespace

Result<PreviewView> previewViewOf(const std::map<std::string, std::string>& query,
                                  const PreviewLimits& limits) {
  constexpr double kAny = 1e300;
  std::string problem;
  const auto number = [&](const char* name, double otherwise, double least, double most) {
    const auto it = query.find(name);
    if (it == query.end()) {
      if (std::isnan(otherwise) && problem.empty()) problem = fmt::format("{} is missing", name);
      return otherwise;
    }
    const auto value = parseNumber(it->second);
    if ((!value || *value < least || *value > most) && problem.empty())
      problem = most >= kAny ? fmt::format("{} is not a number", name)
                             : fmt::format("{} has to be a number from {} to {}", name, least, most);
    return value.value_or(otherwise);
  };
  PreviewView view;
  view.position.lat = geo::radians(number("lat", NAN, -90, 90));
  view.position.lon = geo::radians(number("lon", NAN, -360, 360));
  view.position.height_m = number("height", NAN, -12000, 100000);
  view.heading = geo::radians(number("heading", 0, -360, 360));
  view.pitch = geo::radians(number("pitch", -45, -90, 90));
  view.fov = geo::radians(number("fov", 60, 1, 150));
  view.width = static_cast<int>(number("w", std::min(640, limits.max_width), kLeastSide, limits.max_width));
  view.height =
      static_cast<int>(number("h", std::min(360, limits.max_height), kLeastSide, limits.max_height));
  const double photos = number("photos", 0, 0, PreviewView::kMostPhotos);
  if (problem.empty() && photos != std::floor(photos)) problem = "photos has to be a whole number";
  view.photos = problem.empty() ? static_cast<int>(photos) : 0;
  if (!problem.empty())
    return fail(ErrorCode::BadInput,
                problem + ": /preview.jpg?lat=&lon=&height=&heading=&pitch=&fov=&w=&h=&photos=");
  return view;
}

// The picture that waits to be sent; the next is drawn when it is gone.
class Previews::Stream final : public ResponseStream {
 public:
  Stream(Mission of, const PreviewView& from, const std::string& first)
      : mission(std::move(of)), view(from), drawn(Clock::now()) {
    put(first);
  }
  std::size_t read(char* to, std::size_t capacity) override {
    const std::lock_guard lock(mutex_);
    const auto size = std::min(capacity, pending_.size() - sent_);
    std::memcpy(to, pending_.data() + sent_, size);
    sent_ += size;
    return size;
  }
  void put(const std::string& jpeg) {
    const std::lock_guard lock(mutex_);
    // A browser shows a picture when the next one's boundary has come: it follows at once.
    pending_ = begun_ ? std::string() : fmt::format("--{}\r\n", kBoundary);
    begun_ = true;
    pending_ += fmt::format("Content-Type: image/jpeg\r\nContent-Length: {}\r\n\r\n", jpeg.size());
    pending_ += jpeg;
    pending_ += fmt::format("\r\n--{}\r\n", kBoundary);
    sent_ = 0;
  }
  [[nodiscard]] bool taken() {
    const std::lock_guard lock(mutex_);
    return sent_ == pending_.size();
  }

  const Mission mission;
  const PreviewView view;
  Clock::time_point drawn;  // when the last picture was; the drawing thread's own

 private:
  std::mutex mutex_;
  std::string pending_;
  std::size_t sent_ = 0;
  bool begun_ = false;
};

Previews::Previews(LinkBackend& backend, std::function<void()> wake)
    : backend_(backend), wake_(std::move(wake)) {}

void Previews::stop() {
  std::jthread ending;
  {
    const std::lock_guard lock(mutex_);
    closed_ = true;
    ending = std::move(thread_);
  }
}

Result<std::string> Previews::draw(const Mission& mission, const PreviewView& view) {
  auto picture = backend_.preview(mission, view);
  if (!picture) return tl::unexpected(picture.error());
  Rgba image;
  image.width = picture->width;
  image.height = picture->height;
  image.texels = std::move(picture->rgba);
  return encodeJpeg(image, backend_.previewLimits().jpeg_quality);
}

Result<std::string> Previews::single(const Mission& mission, const PreviewView& view) {
  // Never more than one worker: the others go on serving tiles.
  const std::unique_lock lock(drawing_, std::try_to_lock);
  if (!lock.owns_lock()) return fail(ErrorCode::Unavailable, "another picture is being drawn; ask again");
  const auto now = Clock::now();
  if (now - last_single_ < frameTime(backend_.previewLimits()))
    return fail(ErrorCode::Unavailable, "a picture was drawn a moment ago (preview.max_rate_fps); ask again");
  last_single_ = now;
  return draw(mission, view);
}

Response Previews::stream(const Mission& mission, const PreviewView& view) {
  const auto problem = [](int status, const std::string& text) {
    auto out = Response::text(status, text + "\n");
    if (status == 503) out.headers.emplace_back("Retry-After", "1");
    return out;
  };
  Result<std::string> first;
  {
    const std::unique_lock lock(drawing_, std::try_to_lock);
    if (!lock.owns_lock()) return problem(503, "another picture is being drawn; ask again");
    first = draw(mission, view);
  }
  if (!first) return problem(first.error().code == ErrorCode::Unsupported ? 501 : 503, first.error().message);
  const std::lock_guard lock(mutex_);
  std::erase_if(streams_, [](const auto& stream) { return stream.expired(); });
  if (closed_ || streams_.size() >= kMostStreams)
    return problem(503, fmt::format("there are {} streams of pictures already", streams_.size()));
  auto stream = std::make_shared<Stream>(mission, view, *first);
  streams_.push_back(stream);
  if (!thread_.joinable()) thread_ = std::jthread([this](const std::stop_token& stop) { serve(stop); });
  begun_.notify_one();
  Response out;
  out.headers.emplace_back("Content-Type", fmt::format("multipart/x-mixed-replace; boundary={}", kBoundary));
  out.headers.emplace_back("Cache-Control", "no-store");
  out.stream = std::move(stream);
  return out;
}

void Previews::serve(const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    std::vector<std::shared_ptr<Stream>> open;
    {
      std::unique_lock lock(mutex_);
      std::erase_if(streams_, [](const auto& stream) { return stream.expired(); });
      if (!begun_.wait(lock, stop, [&] { return !streams_.empty(); })) return;
      for (const auto& weak : streams_)
        if (auto stream = weak.lock()) open.push_back(std::move(stream));
    }
    bool drew = false;
    for (const auto& stream : open) {
      if (stop.stop_requested()) return;
      if (!stream->taken() || Clock::now() - stream->drawn < frameTime(backend_.previewLimits())) continue;
      const std::unique_lock lock(drawing_, 1s);
      if (!lock.owns_lock()) continue;
      stream->drawn = Clock::now();
      // What cannot be drawn now may be the next time: the last picture stays.
      if (const auto jpeg = draw(stream->mission, stream->view)) {
        stream->put(*jpeg);
        drew = true;
      }
    }
    open.clear();
    if (drew) wake_();
    std::this_thread::sleep_for(20ms);
  }
}

}  // namespace overfly::link
