#include "capture/record/flight.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <unordered_map>

#include "capture/image_decode.h"
#include "capture/record/detail/flight_text.h"
#include "capture/record/files.h"

namespace overfly::capture {
namespace {

constexpr std::uint64_t kMaxJson = 16u << 20;    // flight.json, cameras.json: bytes
constexpr std::uint64_t kMaxTable = 256u << 20;  // frames.tbl: some 250,000 frames
constexpr std::size_t kMaxWarnings = 100;

void warn(std::vector<std::string>& warnings, std::string text) {
  if (warnings.size() < kMaxWarnings) warnings.push_back(std::move(text));
}

tl::unexpected<Error> about(const std::filesystem::path& file, const Error& error) {
  return fail(error.code, fmt::format("{}: {}", file.string(), error.message));
}

}  // namespace

Flight::Flight(FlightInfo info, std::vector<FlightCamera> cameras, std::vector<FlightFrame> frames,
               std::vector<std::string> warnings, std::size_t skipped)
    : info_(std::move(info)),
      cameras_(std::move(cameras)),
      warnings_(std::move(warnings)),
      skipped_(skipped) {
  std::stable_sort(frames.begin(), frames.end(), [](const FlightFrame& a, const FlightFrame& b) {
    return std::tie(a.frame.time_ns, a.frame.sequence) < std::tie(b.frame.time_ns, b.frame.sequence);
  });
  std::map<std::string, std::int64_t> last_time;  // by camera
  std::erase_if(frames, [&](const FlightFrame& frame) {
    const auto [last, first] = last_time.try_emplace(frame.frame.camera_id, frame.frame.time_ns);
    if (!first && frame.frame.time_ns <= last->second) {
      ++skipped_;
      warn(warnings_, fmt::format("frame {} has the same time as the one before it", frame.frame.name));
      return true;
    }
    last->second = frame.frame.time_ns;
    return false;
  });
  frames.shrink_to_fit();
  frames_ = std::move(frames);
}

Result<Flight> Flight::open(const std::filesystem::path& folder) {
  const auto info_file = folder / "flight.json";
  auto info_text = readText(info_file, kMaxJson);
  if (!info_text) return tl::unexpected(info_text.error());
  auto info = detail::infoFromText(*info_text);
  if (!info) return about(info_file, info.error());

  const auto cameras_file = folder / "cameras.json";
  auto cameras_text = readText(cameras_file, kMaxJson);
  if (!cameras_text) return fail(ErrorCode::Corrupt, cameras_text.error().message);
  auto cameras = detail::camerasFromText(*cameras_text);
  if (!cameras) return about(cameras_file, cameras.error());

  const auto table_file = folder / "frames.tbl";
  const auto table = readText(table_file, kMaxTable);
  if (!table) return fail(ErrorCode::Corrupt, table.error().message);
  std::vector<FlightFrame> frames;
  std::unordered_map<std::string, std::size_t> by_file;
  std::vector<std::string> warnings;
  std::size_t skipped = 0, number = 0;
  std::string_view rest = *table;
  while (!rest.empty()) {
    const std::size_t end = rest.find('\n');
    if (end == std::string_view::npos) break;  // the line that was being written when the recorder ended
    const std::string_view line = rest.substr(0, end);
    rest.remove_prefix(end + 1);
    ++number;
    auto frame = detail::frameFromLine(line, *cameras, info->datum, folder / "images");
    if (frame) {
      // A later line of the same image is the frame with the pose that came after it.
      const auto [at, fresh] = by_file.try_emplace(frame->file, frames.size());
      if (fresh) {
        frames.push_back(std::move(*frame));
      } else {
        frames[at->second] = std::move(*frame);
      }
    } else {
      ++skipped;
      warn(warnings,
           fmt::format("{}, line {} is skipped: {}", table_file.string(), number, frame.error().message));
    }
  }
  return Flight(std::move(*info), std::move(*cameras), std::move(frames), std::move(warnings), skipped);
}

Result<FramePtr> Flight::load(std::size_t index) const {
  const FlightFrame& entry = frames_.at(index);
  auto bytes = readFile(entry.file, detail::kMaxImageBytes);
  if (!bytes) return tl::unexpected(bytes.error());
  const auto wrong = [&](ErrorCode code, const std::string& what) {
    return fail(code, fmt::format("{}: {}", entry.file, what));
  };
  if (entry.bytes && bytes->size() != *entry.bytes) {
    return wrong(ErrorCode::Corrupt,
                 fmt::format("has {} bytes, {} were recorded", bytes->size(), *entry.bytes));
  }
  if (entry.crc && crc32Of(*bytes) != *entry.crc)
    return wrong(ErrorCode::Corrupt, "not the bytes that were recorded");

  auto frame = std::make_shared<Frame>(entry.frame);
  frame->image.bytes = std::move(*bytes);
  if (frame->image.format == PixelFormat::Jpeg) {
    const auto size = jpegSize(frame->image.bytes);
    // A recorder keeps what the camera gave; only what was never checked has to read as an image here.
    if (!size && !entry.crc) return wrong(ErrorCode::BadInput, size.error().message);
    if (size && (size->width != frame->camera.width || size->height != frame->camera.height)) {
      return wrong(ErrorCode::BadInput, fmt::format("is {}x{}, its camera's images are {}x{}", size->width,
                                                    size->height, frame->camera.width, frame->camera.height));
    }
    if (size && !entry.crc) {
      frame->image.width = size->width;
      frame->image.height = size->height;
    }
  } else if (const auto problem = problemOf(frame->image)) {
    return wrong(ErrorCode::BadInput, *problem);
  }
  return FramePtr(std::move(frame));
}

}  // namespace overfly::capture
