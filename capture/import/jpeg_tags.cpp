#include "capture/import/jpeg_tags.h"

#include <fmt/format.h>

#include <charconv>
#include <chrono>
#include <cmath>
#include <exiv2/exiv2.hpp>
#include <map>
#include <vector>

#include "capture/geo/geodetic.h"

namespace overfly::capture {
namespace {

constexpr std::int64_t kSecond = 1'000'000'000;

std::optional<double> numberFrom(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '+')) text.remove_prefix(1);
  while (!text.empty() && text.back() == ' ') text.remove_suffix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || !std::isfinite(value)) return std::nullopt;
  if (end != text.data() + text.size()) {  // "3.61/1" and "8.8 mm" are found in the wild
    const std::string_view rest(end, static_cast<std::size_t>(text.data() + text.size() - end));
    if (rest.front() == '/') {
      const auto divisor = numberFrom(rest.substr(1));
      if (!divisor || *divisor == 0) return std::nullopt;
      return value / *divisor;
    }
    if (rest.front() != ' ') return std::nullopt;
  }
  return value;
}

std::vector<double> numbersFrom(std::string_view text) {
  std::vector<double> numbers;
  while (!text.empty()) {
    const auto end = text.find_first_of(",;");
    const auto value = numberFrom(text.substr(0, end));
    if (!value) return {};
    numbers.push_back(*value);
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
  }
  return numbers;
}

// All tags of a file as text, by Exiv2's key.
class Tags {
 public:
  explicit Tags(const Exiv2::Image& image) {
    for (const auto& item : image.exifData()) {
      if (item.size() <= 4096) exif_[item.key()] = &item.value();
    }
    for (const auto& item : image.xmpData()) {
      if (item.size() <= 65536) xmp_[item.key()] = item.toString();
    }
  }
  std::optional<std::string> text(const std::string& key) const {
    if (const auto found = xmp_.find(key); found != xmp_.end()) return found->second;
    if (const auto found = exif_.find(key); found != exif_.end()) return found->second->toString();
    return std::nullopt;
  }
  std::optional<double> number(const std::string& key) const {
    const auto value = text(key);
    return value ? numberFrom(*value) : std::nullopt;
  }
  // Component of an EXIF rational array; nullopt where the denominator is zero.
  std::optional<double> rational(const std::string& key, long index) const {
    const auto found = exif_.find(key);
    if (found == exif_.end() || found->second->count() <= index) return std::nullopt;
    const auto [up, down] = found->second->toRational(index);
    if (down == 0) return std::nullopt;
    return static_cast<double>(up) / static_cast<double>(down);
  }

 private:
  std::map<std::string, const Exiv2::Value*> exif_;
  std::map<std::string, std::string> xmp_;
};

std::optional<double> gpsAngle(const Tags& tags, const std::string& name, double limit_deg) {
  const auto degrees = tags.rational("Exif.GPSInfo.GPS" + name, 0);
  if (!degrees) return std::nullopt;
  const double value = *degrees + tags.rational("Exif.GPSInfo.GPS" + name, 1).value_or(0) / 60 +
                       tags.rational("Exif.GPSInfo.GPS" + name, 2).value_or(0) / 3600;
  const std::string side = tags.text("Exif.GPSInfo.GPS" + name + "Ref").value_or("");
  if (!(value <= limit_deg)) return std::nullopt;
  return geo::radians(side.starts_with('S') || side.starts_with('W') ? -value : value);
}

std::optional<double> angle(const Tags& tags, const std::string& key) {
  const auto degrees = tags.number(key);
  if (!degrees || std::abs(*degrees) > 720) return std::nullopt;
  return geo::radians(*degrees);
}

std::optional<double> within(std::optional<double> value, double low, double high) {
  return value && *value > low && *value < high ? value : std::nullopt;
}

std::optional<int> digits(const std::string& text, std::size_t at, std::size_t count) {
  int value = 0;
  if (text.size() < at + count) return std::nullopt;
  const auto [end, error] = std::from_chars(text.data() + at, text.data() + at + count, value);
  if (error != std::errc() || end != text.data() + at + count) return std::nullopt;
  return value;
}

// "2016:06-23 16:31:59", any separators, as nanoseconds since 1970.
std::optional<std::int64_t> timeFrom(const std::string& text) {
  const auto year = digits(text, 0, 4), month = digits(text, 5, 2), day = digits(text, 8, 2);
  const auto hour = digits(text, 11, 2), minute = digits(text, 14, 2), second = digits(text, 17, 2);
  if (!year || !month || !day || !hour || !minute || !second || *year < 1970 || *year > 2200)
    return std::nullopt;
  const std::chrono::year_month_day date{std::chrono::year(*year),
                                         std::chrono::month(static_cast<unsigned>(*month)),
                                         std::chrono::day(static_cast<unsigned>(*day))};
  if (!date.ok() || *hour > 23 || *minute > 59 || *second > 60) return std::nullopt;
  const std::int64_t days = std::chrono::sys_days(date).time_since_epoch().count();
  return (days * 86400 + *hour * 3600 + *minute * 60 + *second) * kSecond;
}

void readTime(const Tags& tags, JpegTags& result) {
  const auto text = tags.text("Exif.Photo.DateTimeOriginal");
  result.local_time_ns = timeFrom(text.value_or(tags.text("Exif.Image.DateTime").value_or("")));
  if (!result.local_time_ns) return;
  if (const auto fraction = tags.text("Exif.Photo.SubSecTimeOriginal")) {
    if (const auto value = numberFrom("0." + *fraction); value && *value < 1) {
      *result.local_time_ns += static_cast<std::int64_t>(*value * 1e9);
    }
  }
  if (const auto offset = tags.text("Exif.Photo.OffsetTimeOriginal"); offset && offset->size() >= 6) {
    const auto hours = digits(*offset, 1, 2), minutes = digits(*offset, 4, 2);
    if (hours && minutes && *hours <= 14 && *minutes < 60) {
      result.zone_ns = ((*offset)[0] == '-' ? -1 : 1) * (*hours * 3600 + *minutes * 60) * kSecond;
      return;
    }
  }
  const auto date = tags.text("Exif.GPSInfo.GPSDateStamp");
  const auto hour = tags.rational("Exif.GPSInfo.GPSTimeStamp", 0);
  if (!date || !hour) return;
  const auto midnight = timeFrom(*date + " 00:00:00");
  const double seconds = *hour * 3600 + tags.rational("Exif.GPSInfo.GPSTimeStamp", 1).value_or(0) * 60 +
                         tags.rational("Exif.GPSInfo.GPSTimeStamp", 2).value_or(0);
  if (!midnight || !(seconds >= 0 && seconds < 86401)) return;
  // Zones are whole quarters of an hour; the rest is the camera clock's error and the receiver's delay.
  const double difference = static_cast<double>(*result.local_time_ns - *midnight) / 1e9 - seconds;
  const double quarters = std::round(difference / 900);
  if (std::abs(quarters) <= 14 * 4) result.zone_ns = static_cast<std::int64_t>(quarters) * 900 * kSecond;
}

// The camera from the best that the tags offer. The first pixel's centre is (0.5, 0.5) here; DJI's and
// pix4d's centres are taken as distances from the image's corner and centre, where the question does not
// arise.
void readCamera(const Tags& tags, JpegTags& result) {
  CameraModel model;
  model.width = result.width;
  model.height = result.height;
  model.cx = 0.5 * result.width;
  model.cy = 0.5 * result.height;
  const auto use = [&](std::string reason) {
    if (model.problem()) return false;
    result.camera = model;
    result.camera_reason = std::move(reason);
    return true;
  };
  // drone-dji:DewarpData "date;fx,fy,cx,cy,k1,k2,p1,p2,k3", cx and cy from the image's centre (DJI, "How to
  // use dewarp data", mapping drones).
  if (const auto dewarp = tags.text("Xmp.drone-dji.DewarpData")) {
    const auto semicolon = dewarp->find(';');
    const auto v = numbersFrom(semicolon == std::string::npos ? *dewarp : dewarp->substr(semicolon + 1));
    if (v.size() == 9) {
      CameraModel plain = model;
      model.kind = CameraModel::Kind::RadialTangential;
      model.fx = v[0], model.fy = v[1], model.cx += v[2], model.cy += v[3];
      model.distortion = {v[4], v[5], v[6], v[7], v[8]};
      if (use("factory calibration in drone-dji:DewarpData")) return;
      model = plain;
    }
  }
  const auto sensor_mm = [&](const char* resolution, int pixels) -> std::optional<double> {
    const auto per_unit = tags.rational(resolution, 0);
    const auto unit = tags.number("Exif.Photo.FocalPlaneResolutionUnit").value_or(2);
    if (!per_unit || !(*per_unit > 0)) return std::nullopt;
    const double unit_mm = unit == 3 ? 10 : unit == 4 ? 1 : 25.4;
    return pixels / *per_unit * unit_mm;
  };
  // pix4d's tags: millimetres on the sensor, centre from the sensor's top-left corner.
  const auto sensor = sensor_mm("Exif.Photo.FocalPlaneXResolution", result.width);
  const auto focal_mm = tags.number("Xmp.Camera.PerspectiveFocalLength");
  if (sensor && focal_mm && *sensor > 0.5 && *sensor < 200) {
    const double px_per_mm = result.width / *sensor;
    CameraModel plain = model;
    model.fx = model.fy = *focal_mm * px_per_mm;
    if (const auto centre = numbersFrom(tags.text("Xmp.Camera.PrincipalPoint").value_or(""));
        centre.size() == 2) {
      model.cx = centre[0] * px_per_mm;
      model.cy = centre[1] * px_per_mm;
    }
    const auto k = numbersFrom(tags.text("Xmp.Camera.PerspectiveDistortion").value_or(""));
    if (k.size() == 5) {  // k1, k2, k3, p1, p2
      model.kind = CameraModel::Kind::RadialTangential;
      model.distortion = {k[0], k[1], k[3], k[4], k[2]};
    }
    if (use("calibration in the Camera: tags")) return;
    model = plain;
  }
  if (const auto focal = tags.number("Xmp.drone-dji.CalibratedFocalLength")) {
    model.fx = model.fy = *focal;
    if (const auto cx = tags.number("Xmp.drone-dji.CalibratedOpticalCenterX")) model.cx = *cx;
    if (const auto cy = tags.number("Xmp.drone-dji.CalibratedOpticalCenterY")) model.cy = *cy;
    if (use("drone-dji:CalibratedFocalLength, no distortion")) return;
    model.cx = 0.5 * result.width;
    model.cy = 0.5 * result.height;
  }
  // CIPA DCG-001: the 35-mm equivalent compares diagonals; a 36 x 24 mm frame's is 43.27 mm.
  if (const auto equivalent = tags.number("Exif.Photo.FocalLengthIn35mmFilm");
      equivalent && *equivalent > 0) {
    model.fx = model.fy = *equivalent * std::hypot(result.width, result.height) / std::hypot(36.0, 24.0);
    if (use(fmt::format(
            "{:g} mm 35-mm equivalent over the diagonal, no distortion: good to some per cent, and worse "
            "where the image is a crop of the sensor",
            *equivalent))) {
      return;
    }
  }
  const auto focal = tags.rational("Exif.Photo.FocalLength", 0);
  if (focal && sensor && *sensor > 0.5 && *sensor < 200) {
    model.fx = model.fy = *focal * result.width / *sensor;
    if (use("EXIF focal length over the focal plane's resolution, no distortion")) return;
  }
}

void readPlace(const Tags& tags, JpegTags& result) {
  RawTelemetry& raw = result.raw;
  raw.lat = gpsAngle(tags, "Latitude", 90);
  raw.lon = gpsAngle(tags, "Longitude", 360);
  if (!raw.lat || !raw.lon || (*raw.lat == 0 && *raw.lon == 0)) raw.lat = raw.lon = std::nullopt;  // no fix
  const auto reference = tags.number("Exif.GPSInfo.GPSAltitudeRef").value_or(0);
  if (const auto altitude = tags.rational("Exif.GPSInfo.GPSAltitude", 0)) {
    raw.altitude_m = within(reference == 1 || reference == 3 ? -*altitude : *altitude, -1000, 20000);
  }
  result.altitude_is_ellipsoidal =
      reference == 2 || reference == 3 || tags.text("Xmp.Camera.VertCS").value_or("").starts_with("ellips");
  if (const auto absolute = within(tags.number("Xmp.drone-dji.AbsoluteAltitude"), -1000, 20000)) {
    raw.altitude_m = absolute;
  }
  raw.relative_altitude_m = within(tags.number("Xmp.drone-dji.RelativeAltitude"), -5000, 20000);
  raw.std_north_m = within(tags.number("Xmp.drone-dji.RtkStdLat"), 0, 1000);
  raw.std_east_m = within(tags.number("Xmp.drone-dji.RtkStdLon"), 0, 1000);
  raw.std_up_m = within(tags.number("Xmp.drone-dji.RtkStdHgt"), 0, 1000);
  if (const auto accuracy = within(tags.number("Xmp.Camera.GPSXYAccuracy"), 0, 1000);
      accuracy && !raw.std_north_m) {
    raw.std_north_m = raw.std_east_m = accuracy;
  }
  if (!raw.std_up_m) raw.std_up_m = within(tags.number("Xmp.Camera.GPSZAccuracy"), 0, 1000);
  result.rtk_fixed = tags.number("Xmp.drone-dji.RtkFlag") == 50.0;
}

void readAttitude(const Tags& tags, RawTelemetry& raw) {
  raw.gimbal_yaw = angle(tags, "Xmp.drone-dji.GimbalYawDegree");
  raw.gimbal_pitch = angle(tags, "Xmp.drone-dji.GimbalPitchDegree");
  raw.gimbal_roll = angle(tags, "Xmp.drone-dji.GimbalRollDegree");
  raw.body_yaw = angle(tags, "Xmp.drone-dji.FlightYawDegree");
  raw.body_pitch = angle(tags, "Xmp.drone-dji.FlightPitchDegree");
  raw.body_roll = angle(tags, "Xmp.drone-dji.FlightRollDegree");
  if (raw.gimbal_yaw || raw.gimbal_pitch || raw.gimbal_roll) return;
  // pix4d counts the camera's pitch from straight down.
  raw.gimbal_yaw = angle(tags, "Xmp.Camera.Yaw");
  raw.gimbal_pitch = angle(tags, "Xmp.Camera.Pitch");
  raw.gimbal_roll = angle(tags, "Xmp.Camera.Roll");
  if (raw.gimbal_pitch) *raw.gimbal_pitch -= geo::radians(90);
}

}  // namespace

Result<JpegTags> readJpegTags(const std::filesystem::path& file) {
  try {
    Exiv2::LogMsg::setLevel(Exiv2::LogMsg::mute);
    const auto image = Exiv2::ImageFactory::open(file.string());
    image->readMetadata();
    JpegTags result;
    result.width = static_cast<int>(image->pixelWidth());
    result.height = static_cast<int>(image->pixelHeight());
    if (result.width < 1 || result.height < 1 || result.width > 65500 || result.height > 65500) {
      return fail(ErrorCode::BadInput, fmt::format("{}: its size does not read", file.string()));
    }
    const Tags tags(*image);
    const std::string make = tags.text("Exif.Image.Make").value_or("");
    result.camera_name = tags.text("Exif.Image.Model").value_or("");
    if (!make.empty()) result.camera_name = make + " " + result.camera_name;
    readPlace(tags, result);
    readAttitude(tags, result.raw);
    readTime(tags, result);
    readCamera(tags, result);
    if (const auto exposure = tags.rational("Exif.Photo.ExposureTime", 0);
        exposure && *exposure > 0 && *exposure < 60) {
      result.exposure_ns = static_cast<std::int64_t>(*exposure * 1e9);
    }
    return result;
  } catch (const std::exception& error) {
    return fail(ErrorCode::BadInput,
                fmt::format("{}: its tags do not read: {}", file.string(), error.what()));
  }
}

}  // namespace overfly::capture
