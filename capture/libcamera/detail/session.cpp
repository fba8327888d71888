#include "capture/libcamera/detail/session.h"

#include <fmt/format.h>
#include <libcamera/formats.h>
#include <linux/videodev2.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstring>

#include "capture/libcamera/detail/manager.h"

namespace overfly::capture::lc {
namespace {

using Format = LiveCameraOptions::Format;

struct Pair {
  libcamera::PixelFormat theirs;
  std::uint32_t ours;  // V4L2_PIX_FMT_* of the same bytes
};

// libcamera names formats as DRM does: RGB888 is blue first in memory.
const std::array<Pair, 14>& pairs() {
  namespace f = libcamera::formats;
  static const std::array<Pair, 14> all{{{f::MJPEG, V4L2_PIX_FMT_MJPEG},
                                         {f::NV12, V4L2_PIX_FMT_NV12},
                                         {f::YUYV, V4L2_PIX_FMT_YUYV},
                                         {f::BGR888, V4L2_PIX_FMT_RGB24},
                                         {f::RGB888, V4L2_PIX_FMT_BGR24},
                                         {f::SRGGB8, V4L2_PIX_FMT_SRGGB8},
                                         {f::SGRBG8, V4L2_PIX_FMT_SGRBG8},
                                         {f::SGBRG8, V4L2_PIX_FMT_SGBRG8},
                                         {f::SBGGR8, V4L2_PIX_FMT_SBGGR8},
                                         {f::SRGGB10, V4L2_PIX_FMT_SRGGB10},
                                         {f::SGRBG10, V4L2_PIX_FMT_SGRBG10},
                                         {f::SGBRG10, V4L2_PIX_FMT_SGBRG10},
                                         {f::SBGGR10, V4L2_PIX_FMT_SBGGR10},
                                         {f::R8, V4L2_PIX_FMT_GREY}}};
  return all;
}

tl::unexpected<Error> refused(const std::string& camera, const std::string& what, int error) {
  if (error == -EBUSY)
    return fail(ErrorCode::Unavailable,
                fmt::format("camera {} is in use by another program: end that one", camera));
  return fail(ErrorCode::Io, fmt::format("camera {} did not {}: {}", camera, what, std::strerror(-error)));
}

bool limitedRange(const libcamera::StreamConfiguration& stream, Format format) {
  if (format != Format::Nv12 && format != Format::Yuyv) return false;
  return stream.colorSpace && stream.colorSpace->range == libcamera::ColorSpace::Range::Limited;
}

}  // namespace

Result<std::unique_ptr<Session>> Session::start(const LiveCameraOptions& options,
                                                std::function<void()> wake) {
  std::unique_ptr<Session> session(new Session(std::move(wake)));
  if (auto ok = session->choose(options.device); !ok) return tl::unexpected(ok.error());
  if (auto ok = session->configure(options); !ok) return tl::unexpected(ok.error());
  if (auto ok = session->allocate(); !ok) return tl::unexpected(ok.error());
  if (auto ok = session->begin(options); !ok) return tl::unexpected(ok.error());
  return session;
}

Session::~Session() {
  if (camera_) {
    if (running_) camera_->stop();
    camera_->requestCompleted.disconnect(this);
    camera_->disconnected.disconnect(this);
  }
  requests_.clear();
  buffers_.clear();
  allocator_.reset();
  if (acquired_) camera_->release();
  camera_.reset();
}

Result<void> Session::choose(const std::string& device) {
  manager_ = sharedManager();
  if (!manager_)
    return fail(ErrorCode::Io, "libcamera does not start: may this user open /dev/media* (group video)?");
  std::string there;
  for (const auto& camera : manager_->cameras()) {
    const std::string model = modelOf(*camera);
    there += fmt::format("{}{} ({})", there.empty() ? "" : ", ", camera->id(), model);
    if (!camera_ && (device.empty() || camera->id() == device || model == device)) {
      camera_ = camera;
      id_ = camera->id();
      model_ = model;
    }
  }
  if (!camera_ && there.empty())
    return fail(ErrorCode::Unavailable,
                "libcamera finds no camera: plug one in, and see that this user is in the group video");
  if (!camera_)
    return fail(ErrorCode::Unavailable,
                fmt::format("libcamera finds no camera {}; it finds {}: set source.path", device, there));
  if (const int error = camera_->acquire(); error != 0) return refused(id_, "let itself be acquired", error);
  acquired_ = true;
  return {};
}

Result<void> Session::configure(const LiveCameraOptions& options) {
  configuration_ = camera_->generateConfiguration({libcamera::StreamRole::VideoRecording});
  if (!configuration_ || configuration_->empty())
    configuration_ = camera_->generateConfiguration({libcamera::StreamRole::Viewfinder});
  if (!configuration_ || configuration_->empty())
    return fail(ErrorCode::Unsupported, fmt::format("camera {} has no stream for video", id_));
  libcamera::StreamConfiguration& stream = configuration_->at(0);
  std::string offers;
  for (const PixelLayout& layout : knownLayouts()) {
    const auto pair = std::find_if(pairs().begin(), pairs().end(),
                                   [&](const Pair& one) { return one.ours == layout.fourcc; });
    if (pair == pairs().end()) continue;
    const auto formats = stream.formats().pixelformats();
    if (std::find(formats.begin(), formats.end(), pair->theirs) == formats.end()) continue;
    const auto range = stream.formats().range(pair->theirs);
    offers +=
        fmt::format("{}{} up to {}", offers.empty() ? "" : ", ", nameOf(layout.format), range.max.toString());
    if (options.format != Format::Auto && options.format != layout.format) continue;
    stream.pixelFormat = pair->theirs;
    stream.size = range.max;
    if (options.width > 0) stream.size.width = static_cast<unsigned>(options.width);
    if (options.height > 0) stream.size.height = static_cast<unsigned>(options.height);
    stream.bufferCount = static_cast<unsigned>(options.buffers);
    // What the pipeline makes of it: a size that it cannot do is moved to one that it can.
    if (configuration_->validate() == libcamera::CameraConfiguration::Invalid) continue;
    const auto width = static_cast<int>(stream.size.width), height = static_cast<int>(stream.size.height);
    if (stream.pixelFormat != pair->theirs || (options.width > 0 && options.width != width) ||
        (options.height > 0 && options.height != height)) {
      offers += fmt::format(" (nearest {}x{})", width, height);
      continue;
    }
    if (const int error = camera_->configure(configuration_.get()); error != 0)
      return refused(id_, "take its configuration", error);
    layout_ = layout;
    width_ = width;
    height_ = height;
    stride_ = static_cast<int>(stream.stride);
    limited_range_ = limitedRange(stream, layout.format);
    return {};
  }
  return fail(
      ErrorCode::Unsupported,
      fmt::format("camera {} ({}) does not give {}{}; it gives {}: set camera.format, camera.width_px "
                  "and camera.height_px",
                  id_, model_, nameOf(options.format),
                  options.width > 0 ? fmt::format(" at {}x{}", options.width, options.height) : "",
                  offers.empty() ? "nothing that overfly can read" : offers));
}

Result<void> Session::allocate() {
  libcamera::Stream* stream = configuration_->at(0).stream();
  allocator_ = std::make_unique<libcamera::FrameBufferAllocator>(camera_);
  if (const int error = allocator_->allocate(stream); error < 0) return refused(id_, "make buffers", error);
  for (const auto& buffer : allocator_->buffers(stream)) {
    auto request = camera_->createRequest(buffers_.size());
    if (!request) return fail(ErrorCode::Io, fmt::format("camera {} makes no requests", id_));
    if (const int error = request->addBuffer(stream, buffer.get()); error != 0)
      return refused(id_, "take its buffers", error);
    buffers_.emplace_back(*buffer);
    requests_.push_back(std::move(request));
  }
  return {};
}

libcamera::ControlList Session::controlsFrom(const LiveCameraOptions& options) {
  namespace c = libcamera::controls;
  const libcamera::ControlInfoMap& known = camera_->controls();
  libcamera::ControlList list = lc::controlsFor(*camera_);
  setAutomatic(list, known, options.exposure_ns == 0, options.gain == 0);
  if (options.exposure_ns > 0) {
    if (known.count(&c::ExposureTime) != 0) {
      list.set(c::ExposureTime, static_cast<std::int32_t>(options.exposure_ns / 1'000));
    } else {
      missing_.emplace_back("no exposure control");
    }
  }
  if (options.gain > 0) {
    if (known.count(&c::AnalogueGain) != 0) {
      list.set(c::AnalogueGain, static_cast<float>(options.gain));
    } else {
      missing_.emplace_back("no gain control");
    }
  }
  if (options.rate_fps > 0) {
    if (known.count(&c::FrameDurationLimits) != 0) {
      const auto duration_us = static_cast<std::int64_t>(std::llround(1e6 / options.rate_fps));
      const std::array<std::int64_t, 2> limits{duration_us, duration_us};
      list.set(c::FrameDurationLimits, libcamera::Span<const std::int64_t, 2>(limits));
    } else {
      missing_.emplace_back("no frame rate control");
    }
  }
  if (known.count(&c::AfMode) != 0) list.set(c::AfMode, static_cast<std::int32_t>(c::AfModeManual));
  if (known.count(&c::LensPosition) != 0) {
    list.set(c::LensPosition, static_cast<float>(options.lens_position_dpt));
  } else if (options.lens_position_dpt > 0) {
    missing_.emplace_back("no focus control");
  }
  return list;
}

Result<void> Session::begin(const LiveCameraOptions& options) {
  camera_->requestCompleted.connect(this, &Session::completed);
  camera_->disconnected.connect(this, &Session::disconnected);
  const libcamera::ControlList controls = controlsFrom(options);
  if (const int error = camera_->start(&controls); error != 0) return refused(id_, "start", error);
  running_ = true;
  for (const auto& request : requests_)
    if (const int error = camera_->queueRequest(request.get()); error != 0)
      return refused(id_, "take its requests", error);
  return {};
}

void Session::completed(libcamera::Request* request) {
  if (request->status() == libcamera::Request::RequestCancelled) return;
  {
    const std::scoped_lock lock(mutex_);
    done_.push_back(request);
  }
  wake_();
}

void Session::disconnected() {
  {
    const std::scoped_lock lock(mutex_);
    lost_ = true;
  }
  wake_();
}

bool Session::lost() const {
  const std::scoped_lock lock(mutex_);
  return lost_;
}

std::optional<Completed> Session::take() {
  libcamera::Request* request = nullptr;
  {
    const std::scoped_lock lock(mutex_);
    if (done_.empty()) return std::nullopt;
    request = done_.front();
    done_.pop_front();
  }
  namespace c = libcamera::controls;
  const libcamera::FrameMetadata& buffer = request->buffers().begin()->second->metadata();
  Completed out;
  out.request = request;
  out.damaged = buffer.status != libcamera::FrameMetadata::FrameSuccess;
  out.sequence = buffer.sequence;
  out.sensor_ns = metadataOf(*request, c::SensorTimestamp);
  out.buffer_ns = static_cast<std::int64_t>(buffer.timestamp);
  out.exposure_ns = std::int64_t{metadataOf(*request, c::ExposureTime).value_or(0)} * 1'000;
  out.gain = static_cast<double>(metadataOf(*request, c::AnalogueGain).value_or(0)) *
             static_cast<double>(metadataOf(*request, c::DigitalGain).value_or(1));
  return out;
}

Result<Image> Session::imageOf(const Completed& completed) const {
  const MappedBuffer& buffer = buffers_[completed.request->cookie()];
  const auto used = completed.request->buffers().begin()->second->metadata().planes();
  const auto& planes = buffer.planes();
  if (planes.empty() || planes.front().empty())
    return fail(ErrorCode::BadInput, "the camera's buffer cannot be read by this process");
  std::span<const std::uint8_t> bytes = planes.front();
  std::vector<std::uint8_t> gathered;
  if (planes.size() > 1) {
    // Planes that follow one another are one run of bytes; others are brought together.
    const bool adjacent = planes[1].data() == planes[0].data() + planes[0].size();
    if (adjacent) {
      bytes = {planes[0].data(), planes[0].size() + planes[1].size()};
    } else {
      const std::size_t luma =
          std::min(planes[0].size(), static_cast<std::size_t>(stride_) * static_cast<std::size_t>(height_));
      gathered.assign(planes[0].begin(), planes[0].begin() + static_cast<std::ptrdiff_t>(luma));
      gathered.insert(gathered.end(), planes[1].begin(), planes[1].end());
      bytes = gathered;
    }
  } else if (used.size() == 1) {
    bytes = bytes.first(std::min<std::size_t>(bytes.size(), used[0].bytesused));
  }
  buffer.beginReading();
  auto image = takeImage(bytes, layout_, width_, height_, stride_, limited_range_);
  buffer.endReading();
  return image;
}

Result<void> Session::giveBack(libcamera::Request* request) {
  request->reuse(libcamera::Request::ReuseBuffers);
  if (const int error = camera_->queueRequest(request); error != 0)
    return refused(id_, "take a request back", error);
  return {};
}

}  // namespace overfly::capture::lc
