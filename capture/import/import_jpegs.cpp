#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <map>

#include "capture/import/camera_file.h"
#include "capture/import/detail/importers.h"
#include "capture/import/device_pose.h"
#include "capture/import/jpeg_tags.h"
#include "capture/record/pose_check.h"

namespace overfly::capture::detail {
namespace {

constexpr std::int64_t kSecond = 1'000'000'000;

struct Tagged {
  std::filesystem::path file;
  JpegTags tags;
  std::int64_t time_ns = 0;
};

void chooseDatum(const std::vector<Tagged>& images, FlightInfo& info) {
  const auto all = [&](auto holds) { return std::all_of(images.begin(), images.end(), holds); };
  if (all([](const Tagged& i) { return i.tags.altitude_is_ellipsoidal; })) {
    info.datum = VerticalDatum::Ellipsoid;
    info.datum_reason = "the images' tags say that their altitudes are ellipsoidal";
  } else if (all([](const Tagged& i) { return i.tags.rtk_fixed; })) {
    info.datum = VerticalDatum::Ellipsoid;
    info.datum_reason =
        "every image has a fixed RTK position, and DJI writes those as heights above the reference station's "
        "ellipsoid";
  } else {
    info.datum = VerticalDatum::Unknown;
    info.datum_reason =
        "EXIF calls the altitudes \"above sea level\", which drones without RTK do not keep: they differ by "
        "tens of "
        "metres between models, so they pass through unshifted";
  }
}

// Times as UTC where the images allow it; images of one second without fractions are spread over it in the
// order of their names, because times have to increase.
void setTimes(std::vector<Tagged>& images, FlightInfo& info) {
  const auto zone =
      std::find_if(images.begin(), images.end(), [](const Tagged& i) { return i.tags.zone_ns; });
  for (Tagged& image : images) {
    image.time_ns = *image.tags.local_time_ns -
                    image.tags.zone_ns.value_or(zone != images.end() ? *zone->tags.zone_ns : 0);
  }
  info.notes.push_back(zone != images.end()
                           ? "times are UTC, from EXIF and its time zone or the GPS time"
                           : "times are the camera's local time taken as UTC: no zone, no GPS time");
  std::stable_sort(images.begin(), images.end(),
                   [](const Tagged& a, const Tagged& b) { return a.time_ns < b.time_ns; });
  std::size_t spread = 0;
  for (std::size_t first = 0; first < images.size();) {
    std::size_t end = first + 1;
    while (end < images.size() && images[end].time_ns == images[first].time_ns) ++end;
    const auto count = static_cast<std::int64_t>(end - first);
    for (std::size_t i = first; i < end && count > 1; ++i) {
      images[i].time_ns += static_cast<std::int64_t>(i - first) * kSecond / count;
      ++spread;
    }
    first = end;
  }
  if (spread > 0) {
    info.notes.push_back(
        fmt::format("{} images share a second: spread over it in the order of their names", spread));
  }
}

}  // namespace

std::vector<std::filesystem::path> jpegsIn(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> files;
  for (const auto& place : {folder, folder / "images"}) {
    std::error_code code;
    for (std::filesystem::directory_iterator entry(place, code), end; !code && entry != end;
         entry.increment(code)) {
      std::string extension = entry->path().extension().string();
      for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
      std::error_code kind;
      const bool hidden = entry->path().filename().string().starts_with('.');
      if ((extension == ".jpg" || extension == ".jpeg") && !hidden && entry->is_regular_file(kind)) {
        files.push_back(entry->path());
      }
    }
    if (!files.empty()) break;
  }
  std::sort(files.begin(), files.end());
  return files;
}

Result<Flight> importJpegs(const std::filesystem::path& folder, const ImportOptions& options) {
  FlightInfo info;
  info.made_by = "overfly import";
  info.source = std::filesystem::absolute(folder).lexically_normal().string();
  info.boot_id = "utc";

  std::optional<CameraFile> given;
  std::error_code code;
  if (options.camera_file || std::filesystem::exists(folder / "camera.json", code)) {
    auto read = readCameraFile(options.camera_file.value_or(folder / "camera.json"));
    if (!read) return fail(ErrorCode::BadInput, read.error().message);
    given = std::move(*read);
    info.notes.push_back(given->convention);
  }

  Skips skips;
  std::vector<Tagged> images;
  for (const auto& file : jpegsIn(folder)) {
    auto tags = readJpegTags(file);
    const auto skip = [&](const char* why) {
      skips.add(fmt::format("{} is skipped: {}", file.string(), why));
    };
    if (!tags) {
      skips.add(tags.error().message);
    } else if (!tags->local_time_ns) {
      skip("it has no time");
    } else if (given && (given->model.width != tags->width || given->model.height != tags->height)) {
      skip("its size is not the camera file's");
    } else if (!given && !tags->camera) {
      skip("its tags give no focal length, and there is no camera file");
    } else {
      images.push_back({file, std::move(*tags), 0});
    }
  }
  if (images.empty()) {
    return fail(ErrorCode::BadInput,
                fmt::format("{}: no image is usable; the first: {}", folder.string(),
                            skips.warnings.empty() ? "none there" : skips.warnings.front()));
  }
  chooseDatum(images, info);
  setTimes(images, info);

  std::vector<FlightCamera> cameras;
  std::vector<FlightFrame> frames;
  for (std::size_t i = 0; i < images.size(); ++i) {
    const JpegTags& tags = images[i].tags;
    FlightFrame entry;
    entry.file = images[i].file.string();
    Frame& frame = entry.frame;
    frame.sequence = i;
    frame.name = images[i].file.filename().string();
    frame.camera = given ? given->model : *tags.camera;
    frame.camera_id = tags.camera_name.empty() ? "main" : tags.camera_name;
    frame.time_ns = images[i].time_ns;
    frame.exposure_ns = tags.exposure_ns;
    frame.image.width = tags.width;
    frame.image.height = tags.height;
    frame.datum = info.datum;
    if (!tags.raw.empty()) entry.raw = std::make_shared<const RawTelemetry>(tags.raw);
    frame.pose = devicePose(tags.raw, frame.time_ns);
    if (frame.pose && checkPose(*frame.pose)) frame.pose.reset();
    int revision = 0;
    bool known = false;
    for (const FlightCamera& camera : cameras) {
      if (camera.id != frame.camera_id) continue;
      known = known || camera.model == frame.camera;
      revision = camera.revision + 1;
    }
    if (!known) {
      cameras.push_back({frame.camera_id, revision, frame.camera});
      if (!given) info.notes.push_back(fmt::format("camera {}: {}", frame.camera_id, tags.camera_reason));
    }
    frames.push_back(std::move(entry));
  }
  groundFromTakeOff(frames, info);
  return Flight(std::move(info), std::move(cameras), std::move(frames), std::move(skips.warnings),
                skips.count);
}

}  // namespace overfly::capture::detail
