#include "capture/record/recorder.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <set>
#include <thread>
#include <utility>

#include "capture/image_decode.h"
#include "capture/record/detail/flight_text.h"
#include "capture/record/files.h"

namespace overfly::capture {
namespace {

using Clock = std::chrono::steady_clock;
constexpr std::size_t kMaxUnposed = 4096;
constexpr std::size_t kMaxUnsynced = 64;  // images held open for the next sync; beyond them record() waits

std::string bootId() {
  // A file of /proc has no length: it is read by hand.
  const FileDescriptor file(::open("/proc/sys/kernel/random/boot_id", O_RDONLY | O_CLOEXEC));
  char text[36];
  return file && ::read(file.get(), text, sizeof(text)) == sizeof(text) ? std::string(text, sizeof(text))
                                                                        : "";
}

Result<FileDescriptor> openToAppend(const std::filesystem::path& path) {
  FileDescriptor file(::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_APPEND | O_CLOEXEC, 0644));
  if (!file) return systemFailure("cannot create", path);
  return file;
}

Result<void> syncFile(const FileDescriptor& file, const std::filesystem::path& path) {
  if (::fdatasync(file.get()) != 0) return systemFailure("cannot bring to the disk", path);
  return {};
}

// Makes new names in a folder last.
Result<void> syncFolder(const std::filesystem::path& folder) {
  const FileDescriptor file(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (!file || ::fsync(file.get()) != 0) return systemFailure("cannot bring to the disk", folder);
  return {};
}

std::string extensionOf(PixelFormat format) {
  return format == PixelFormat::Jpeg ? ".jpg" : std::string(".") + nameOf(format);
}

}  // namespace

// Two locks, taken in this order where both are: frames_mutex guards the images, the table and the cameras;
// raw_mutex the raw log, so that a slow image does not hold up telemetry. Files are brought to the disk by a
// thread of its own and outside of both: a slow card must not keep the camera's thread from its next picture.
class FlightRecorder::Files {
 public:
  static Result<std::unique_ptr<Files>> create(const std::filesystem::path& folder, FlightInfo info,
                                               const RecorderOptions& options) {
    std::error_code code;
    std::filesystem::create_directories(folder / "images", code);
    if (code)
      return fail(ErrorCode::Io, fmt::format("cannot create {}: {}", folder.string(), code.message()));
    for (const auto& entry : std::filesystem::directory_iterator(folder, code)) {
      if (entry.path().filename() != "images") {
        return fail(ErrorCode::BadInput, fmt::format("{} already holds {}: choose a new folder",
                                                     folder.string(), entry.path().filename().string()));
      }
    }
    if (code) return fail(ErrorCode::Io, fmt::format("cannot read {}: {}", folder.string(), code.message()));
    if (info.boot_id.empty()) info.boot_id = bootId();

    auto files = std::unique_ptr<Files>(new Files(folder, options));
    auto table = openToAppend(folder / "frames.tbl");
    if (!table) return tl::unexpected(table.error());
    files->table_ = std::move(*table);
    auto raw = openToAppend(folder / "raw.log");
    if (!raw) return tl::unexpected(raw.error());
    files->raw_ = std::move(*raw);
    if (auto done = writeAll(files->raw_.get(), bytesOf("OVFRAW1\n"), folder / "raw.log"); !done) {
      return tl::unexpected(done.error());
    }
    if (auto done = files->writeCameras(); !done) return tl::unexpected(done.error());
    const std::string text = detail::infoText(info);
    auto written = replaceFile(folder / "flight.json", bytesOf(text));
    if (!written) return tl::unexpected(written.error());
    if (auto done = syncFile(*written, folder / "flight.json"); !done) return tl::unexpected(done.error());
    if (auto done = syncFolder(folder); !done) return tl::unexpected(done.error());
    files->syncer_ =
        std::jthread([self = files.get()](const std::stop_token& stop) { self->syncOften(stop); });
    return files;
  }

  Result<void> record(const Frame& frame, const TelemetryPtr& raw) {
    if (const auto problem = problemOf(frame.image)) return fail(ErrorCode::BadInput, *problem);
    if (const auto problem = frame.camera.problem()) return fail(ErrorCode::BadInput, *problem);
    const Image& pixels = frame.image;
    if (pixels.bytes.size() > detail::kMaxImageBytes) {
      return fail(ErrorCode::BadInput,
                  fmt::format("an image of {} bytes is too large to keep", pixels.bytes.size()));
    }
    if (pixels.width != 0 && (pixels.width != frame.camera.width || pixels.height != frame.camera.height)) {
      return fail(ErrorCode::BadInput,
                  fmt::format("the image is {}x{}, its camera's images are {}x{}", pixels.width,
                              pixels.height, frame.camera.width, frame.camera.height));
    }
    std::unique_lock lock(frames_mutex_);
    if (!table_) return fail(ErrorCode::Unavailable, "the recorder is closed");
    const auto revision = revisionOf(frame);
    if (!revision) return tl::unexpected(revision.error());

    const std::string name = freeName(frame);
    const auto path = folder_ / "images" / name;
    const std::string line =
        detail::frameLine(frame, *revision, name, frame.image.bytes.size(), crc32Of(frame.image.bytes), raw);
    if (line.size() > detail::kMaxLine)
      return fail(ErrorCode::BadInput, "the frame's names are too long to keep");
    auto image = replaceFile(path, frame.image.bytes);
    if (!image) return tl::unexpected(image.error());
    names_.insert(name);
    unsynced_.push_back(std::move(*image));
    if (auto done = appendWhole(table_.get(), bytesOf(line), folder_ / "frames.tbl"); !done) return done;
    ++count_;
    if (!frame.pose) keepUnposed(frame, *revision, name, raw);
    if (options_.sync_interval.count() == 0) return syncAll(lock);
    if (Clock::now() - last_sync_ >= options_.sync_interval || unsynced_.size() >= kMaxUnsynced) {
      sync_wanted_ = true;
      changed_.notify_all();
    }
    changed_.wait(lock, [this] { return unsynced_.size() < kMaxUnsynced || !table_; });
    return std::exchange(sync_outcome_, Result<void>());
  }

  Result<void> record(const LatePose& late) {
    const std::lock_guard lock(frames_mutex_);
    if (!table_) return fail(ErrorCode::Unavailable, "the recorder is closed");
    const auto found = std::find_if(unposed_.begin(), unposed_.end(), [&](const Unposed& one) {
      return one.frame.sequence == late.sequence && one.frame.camera_id == late.camera_id;
    });
    if (found == unposed_.end())
      return fail(ErrorCode::NotFound,
                  fmt::format("no frame {} of {} waits for a pose", late.sequence, late.camera_id));
    found->frame.pose = late.pose;
    found->frame.datum = late.datum;
    const std::string line =
        detail::frameLine(found->frame, found->revision, found->file, found->bytes, found->crc, found->raw);
    unposed_.erase(found);
    return appendWhole(table_.get(), bytesOf(line), folder_ / "frames.tbl");
  }

  Result<void> record(const RawInput& input) {
    const auto bytes = encodeRawInput(input);
    if (!bytes) return tl::unexpected(bytes.error());
    const std::lock_guard lock(raw_mutex_);
    if (!raw_) return fail(ErrorCode::Unavailable, "the recorder is closed");
    return appendWhole(raw_.get(), *bytes, folder_ / "raw.log");
  }

  Result<void> sync() {
    std::unique_lock lock(frames_mutex_);
    return table_ ? syncAll(lock) : Result<void>{};
  }

  Result<void> close() {
    std::unique_lock lock(frames_mutex_);
    if (!table_) return {};
    auto done = syncAll(lock);
    table_ = FileDescriptor();
    changed_.notify_all();
    const std::lock_guard raw_lock(raw_mutex_);
    raw_ = FileDescriptor();
    return done;
  }

  std::uint64_t count() const {
    const std::lock_guard lock(frames_mutex_);
    return count_;
  }

 private:
  Files(std::filesystem::path folder, const RecorderOptions& options)
      : folder_(std::move(folder)), options_(options) {}

  // What a frame's line says, without its pixels.
  struct Unposed {
    Frame frame;
    int revision = 0;
    std::string file;
    std::uint64_t bytes = 0;
    std::uint32_t crc = 0;
    TelemetryPtr raw;
  };

  void keepUnposed(const Frame& frame, int revision, const std::string& file, const TelemetryPtr& raw) {
    Unposed one;
    one.frame.sequence = frame.sequence;
    one.frame.name = frame.name;
    one.frame.camera_id = frame.camera_id;
    one.frame.time_ns = frame.time_ns;
    one.frame.time_sigma_ns = frame.time_sigma_ns;
    one.frame.utc_offset_ns = frame.utc_offset_ns;
    one.frame.exposure_ns = frame.exposure_ns;
    one.frame.gain = frame.gain;
    one.frame.image.format = frame.image.format;
    one.frame.image.width = frame.image.width;
    one.frame.image.height = frame.image.height;
    one.frame.image.stride = frame.image.stride;
    one.revision = revision;
    one.file = file;
    one.bytes = frame.image.bytes.size();
    one.crc = crc32Of(frame.image.bytes);
    one.raw = raw;
    unposed_.push_back(std::move(one));
    if (unposed_.size() > kMaxUnposed) unposed_.pop_front();
  }

  Result<void> writeCameras() {
    const std::string text = detail::camerasText(cameras_);
    const auto written = replaceFile(folder_ / "cameras.json", bytesOf(text));
    if (!written) return tl::unexpected(written.error());
    return syncFile(*written, folder_ / "cameras.json");
  }

  Result<int> revisionOf(const Frame& frame) {
    int next = 0;
    for (const FlightCamera& camera : cameras_) {
      if (camera.id != frame.camera_id) continue;
      if (camera.model == frame.camera) return camera.revision;
      next = camera.revision + 1;
    }
    cameras_.push_back({frame.camera_id, next, frame.camera});
    if (auto done = writeCameras(); !done) {
      cameras_.pop_back();
      return tl::unexpected(done.error());
    }
    return next;
  }

  // The frame's own name where it can be a file's and is not taken.
  std::string freeName(const Frame& frame) const {
    const std::string extension = extensionOf(frame.image.format);
    std::string name = frame.name;
    if (!detail::isPlainFileName(name)) name = fmt::format("{:08}{}", frame.sequence, extension);
    for (int attempt = 2; names_.contains(name); ++attempt) {
      name = fmt::format("{:08}_{}{}", frame.sequence, attempt, extension);
    }
    return name;
  }

  // The descriptors of table and raw log stay open while syncing_: close() waits for it.
  Result<void> bringToDisk(const std::vector<FileDescriptor>& images) const {
    Result<void> result;
    const auto keep = [&](Result<void> done) {
      if (!done && result) result = std::move(done);
    };
    for (const FileDescriptor& image : images) keep(syncFile(image, folder_ / "images"));
    keep(syncFolder(folder_ / "images"));
    keep(syncFile(table_, folder_ / "frames.tbl"));
    keep(syncFile(raw_, folder_ / "raw.log"));
    return result;
  }

  // Everything so far, without holding the lock meanwhile.
  Result<void> syncUnlocked(std::unique_lock<std::mutex>& lock) {
    const std::vector<FileDescriptor> images = std::exchange(unsynced_, {});
    syncing_ = true;
    sync_wanted_ = false;
    last_sync_ = Clock::now();
    changed_.notify_all();
    lock.unlock();
    Result<void> done = bringToDisk(images);
    lock.lock();
    syncing_ = false;
    changed_.notify_all();
    return done;
  }

  Result<void> syncAll(std::unique_lock<std::mutex>& lock) {
    changed_.wait(lock, [this] { return !syncing_; });
    if (!table_) return {};
    Result<void> before = std::exchange(sync_outcome_, Result<void>());
    Result<void> done = syncUnlocked(lock);
    return before ? done : before;
  }

  void syncOften(const std::stop_token& stop) {
    std::unique_lock lock(frames_mutex_);
    while (changed_.wait(lock, stop, [this] { return sync_wanted_ && !syncing_; })) {
      if (!table_) return;
      if (auto done = syncUnlocked(lock); !done) sync_outcome_ = std::move(done);
    }
  }

  const std::filesystem::path folder_;
  const RecorderOptions options_;
  mutable std::mutex frames_mutex_;
  FileDescriptor table_;
  std::vector<FlightCamera> cameras_;
  std::set<std::string> names_;
  std::deque<Unposed> unposed_;
  std::vector<FileDescriptor> unsynced_;
  Clock::time_point last_sync_ = Clock::now();
  std::condition_variable_any changed_;  // what follows, unsynced_ and table_
  bool sync_wanted_ = false, syncing_ = false;
  Result<void> sync_outcome_;  // what went wrong behind the callers' backs; the next one is told
  std::uint64_t count_ = 0;
  std::mutex raw_mutex_;
  FileDescriptor raw_;
  std::jthread syncer_;  // last: it ends before the rest goes
};

FlightRecorder::FlightRecorder(std::unique_ptr<Files> files) : files_(std::move(files)) {}
FlightRecorder::FlightRecorder(FlightRecorder&&) noexcept = default;
FlightRecorder& FlightRecorder::operator=(FlightRecorder&&) noexcept = default;

FlightRecorder::~FlightRecorder() {
  if (files_) (void)files_->close();
}

Result<FlightRecorder> FlightRecorder::create(const std::filesystem::path& folder, FlightInfo info,
                                              const RecorderOptions& options) {
  auto files = Files::create(folder, std::move(info), options);
  if (!files) return tl::unexpected(files.error());
  return FlightRecorder(std::move(*files));
}

Result<void> FlightRecorder::record(const Frame& frame, const TelemetryPtr& raw) {
  return files_->record(frame, raw);
}
Result<void> FlightRecorder::record(const RawInput& input) { return files_->record(input); }
Result<void> FlightRecorder::record(const LatePose& late) { return files_->record(late); }
Result<void> FlightRecorder::sync() { return files_->sync(); }
Result<void> FlightRecorder::close() { return files_->close(); }
std::uint64_t FlightRecorder::framesRecorded() const { return files_->count(); }

}  // namespace overfly::capture
