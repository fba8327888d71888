#include "config/description.h"

#include <type_traits>
#include <utility>

#include "config/detail/section_table.h"

// To add a setting: a field in settings.h and a line here. To add a section: a struct and a member of
// Settings, and a function here that is called by description().
namespace overfly::config {
namespace {

using detail::choices;
using detail::Range;
using detail::SectionTable;

constexpr double kMany = 1e9;  // "no upper bound" of counts and sizes

SectionInfo describeSource() {
  SectionTable t("source", &Settings::source, "Where frames come from.");
  t.key("kind", &Source::kind, choices<SourceKind>({"replay", "scene", "v4l2", "libcamera"}),
        "replay plays a recorded flight, scene simulates one, v4l2 and libcamera are live cameras");
  t.key("path", &Source::path,
        "folder of the flight, scene file, device node (/dev/video0), or libcamera's id or model; empty "
        "takes the "
        "first camera that there is");
  t.key("speed", &Source::speed, Range{0, 1000},
        "pace of a replay or a scene: 1 is true time, 2 twice as fast, 0 as fast as the frames are taken");
  t.key("loop", &Source::loop, "begins a replay again at its end");
  t.key("start_frame", &Source::start_frame, Range{0, kMany}, "first frame of a replay, counted from 0");
  t.key("retry_s", &Source::retry_s, Range{0.1, 3600}, "pause before an absent source is tried again");
  return t.take();
}

SectionInfo describeCamera() {
  SectionTable t("camera", &Settings::camera,
                 "The camera and how it takes pictures; what a replay says itself wins.");
  t.key("id", &Camera::id, "name of the camera in the recorded flight");
  t.key("model_file", &Camera::model_file,
        "JSON file with focal lengths, principal point and distortion; empty takes what the flight or the "
        "images say; a live camera needs one");
  t.key("width_px", &Camera::width_px, Range{0, 65535}, "width of a picture; 0 takes the largest");
  t.key("height_px", &Camera::height_px, Range{0, 65535}, "height of a picture; 0 takes the largest");
  t.key("rate_fps", &Camera::rate_fps, Range{0, 1000}, "frames per second; 0 leaves it to the camera");
  t.key("format", &Camera::format,
        choices<CameraFormat>({"auto", "mjpeg", "nv12", "yuyv", "grey", "rgb", "bayer8", "bayer10"}),
        "pixel format asked of the camera; auto takes the first of these that it has, grey last");
  t.key("exposure_us", &Camera::exposure_us, Range{0, 1e7}, "exposure time; 0 is automatic").live();
  t.key("gain", &Camera::gain, Range{0, 1000},
        "linear sensor gain (v4l2: in the driver's own steps); 0 is automatic")
      .live();
  t.key("lens_position_dpt", &Camera::lens_position_dpt, Range{0, 50}, "fixed focus; 0 is infinity").live();
  t.key("rolling_shutter_ms", &Camera::rolling_shutter_ms, Range{0, 1000},
        "time from the first row's exposure to the last row's; 0 for a global shutter");
  t.key("buffers", &Camera::buffers, Range{2, 32}, "capture buffers asked of the driver");
  return t.take();
}

SectionInfo describeGpio() {
  SectionTable t("gpio", &Settings::gpio,
                 "Electrical time stamps: the camera's exposure pulse and the receiver's PPS.");
  t.key("chip", &Gpio::chip, "GPIO chip (gpiochip0, /dev/gpiochip0); empty uses none");
  t.key("exposure_line", &Gpio::exposure_line, Range{-1, 1023},
        "line of the exposure pulse; -1 when not wired");
  t.key("exposure_edge", &Gpio::exposure_edge, choices<GpioEdge>({"rising", "falling"}),
        "edge at which the exposure begins");
  t.key("pps_line", &Gpio::pps_line, Range{-1, 1023}, "line of the pulse per second; -1 when not wired");
  t.key("pps_edge", &Gpio::pps_edge, choices<GpioEdge>({"rising", "falling"}),
        "edge at which the second begins");
  t.key("debounce_us", &Gpio::debounce_us, Range{0, 1000000},
        "edges that follow another of their line sooner than this are dropped");
  t.key("expected_lag_ms", &Gpio::expected_lag_ms, Range{-10000, 10000},
        "by how much a frame's own stamp is expected to lag behind its pulse: it decides where pulses and "
        "frames both come as regularly as a clock");
  t.key("trigger_line", &Gpio::trigger_line, Range{-1, 1023},
        "output line that releases the camera; -1 for none");
  t.key("trigger_interval_ms", &Gpio::trigger_interval_ms, Range{10, 3600000}, "time between releases");
  t.key("trigger_width_us", &Gpio::trigger_width_us, Range{10, 1000000}, "length of a release pulse");
  return t.take();
}

SectionInfo describePose() {
  SectionTable t("pose", &Settings::pose,
                 "Poses: where they come from, how the camera is mounted, what is believed.");
  t.key("mavlink", &PoseSettings::mavlink,
        {"(udp:([^:]+:)?\\d+|tcp:[^:]+:\\d+|serial:[^:]+(:\\d+)?)?",
         "udp:[ADDRESS:]PORT, tcp:HOST:PORT, serial:DEVICE[:BAUD], or empty"},
        "where the autopilot speaks MAVLink; empty for none");
  t.key("system_id", &PoseSettings::system_id, Range{1, 255}, "the autopilot's MAVLink system");
  t.key("component_id", &PoseSettings::component_id, Range{1, 255}, "overfly's own MAVLink component");
  t.key("signing_key", &PoseSettings::signing_key,
        "file with the MAVLink signing key, 32 bytes or 64 hexadecimal digits: all packets are signed then, "
        "and "
        "unsigned ones are refused; empty for neither");
  t.key("request_streams", &PoseSettings::request_streams,
        "asks the autopilot for the messages that poses need, at the rates that they need");
  t.key("attitude", &PoseSettings::attitude, choices<PoseAttitude>({"auto", "body", "gimbal"}),
        "whose attitude the camera shares; auto takes the gimbal's once one reports");
  t.key("height", &PoseSettings::height, choices<PoseHeight>({"auto", "ellipsoid", "msl", "home"}),
        "what heights are counted from: auto makes the autopilot's ellipsoidal by map.geoid_model or by what "
        "the receiver says, and leaves them at mean sea level where neither is there; ellipsoid waits "
        "instead; msl and home are not shifted");
  t.key("pulses", &PoseSettings::pulses, choices<PosePulses>({"auto", "none", "gpio", "trigger", "feedback"}),
        "what stamps the frames: gpio.exposure_line, or the autopilot's CAMERA_TRIGGER or CAMERA_FEEDBACK; "
        "auto takes gpio where a line is given, else none");
  t.key("max_gap_ms", &PoseSettings::max_gap_ms, Range{1, 60000},
        "longest gap between two poses across which a pose is interpolated")
      .live();
  t.key("max_wait_ms", &PoseSettings::max_wait_ms, Range{0, 60000},
        "how long a frame waits for its pose before it is only recorded")
      .live();
  t.key("max_tilt_deg", &PoseSettings::max_tilt_deg, Range{0, 180},
        "frames that look further away from straight down are not mapped")
      .live();
  t.key("lever_arm_m", &PoseSettings::lever_arm_m, Range{-100, 100},
        "camera's place as seen from the antenna, in body axes: forward, right, down");
  t.key("boresight_deg", &PoseSettings::boresight_deg, Range{-180, 180},
        "turn from the body's axes to the camera's mount: roll, pitch, yaw");
  t.key("delay_ms", &PoseSettings::delay_ms, Range{-10000, 10000},
        "added to a frame's time before its pose is looked up");
  t.key("position_sigma_m", &PoseSettings::position_sigma_m, Range{0, 1000},
        "standard deviation of a position; 0 takes what the source says");
  t.key("attitude_sigma_deg", &PoseSettings::attitude_sigma_deg, Range{0, 180},
        "standard deviation of an attitude; 0 takes what the source says");
  return t.take();
}

SectionInfo describeMission() {
  SectionTable t("mission", &Settings::mission, "Missions: one map and one recorded flight each.");
  t.key("start", &Mission::start, choices<MissionStart>({"boot", "arming", "command"}),
        "what starts a mission: the daemon's start, the autopilot's arming (which also ends it), or only "
        "`overfly mission start` and the link; a mission that a restart interrupted goes on in any case")
      .live();
  return t.take();
}

SectionInfo describeRecord() {
  SectionTable t(
      "record", &Settings::record,
      "Recording of the flight: always, in the mission's folder beside its map, because a frame is "
      "mapped from there when its turn comes.");
  t.key("raw_inputs", &Record::raw_inputs, "keeps telemetry packets, GPIO edges and clock pairs too");
  t.key("min_free_mb", &Record::min_free_mb, Range{0, kMany},
        "frames are refused when the disk has less left")
      .live();
  return t.take();
}

SectionInfo describeMap() {
  SectionTable t("map", &Settings::map,
                 "The map: where it lies, its grid and its heights. A map keeps what it was begun with.");
  t.key("folder", &Map::folder, "folder of the tile store");
  t.key("tile_size", &Map::tile_size, {256, 512}, "texels along a tile's side");
  t.key("lattice", &Map::lattice,
        {"webmercator|utm(:([1-9]|[1-5]\\d|60)[NS])?|ups(:[NS])?|local(:-?\\d+(\\.\\d+)?,-?\\d+(\\.\\d+)?)?",
         "webmercator, utm[:ZONE(N|S)], ups[:N|S], or local[:LAT,LON]"},
        "grid of the tiles; what is not given of utm, ups and local is taken from the first frame");
  t.key("gsd_m", &Map::gsd_m, Range{0, 100},
        "ground size of a texel at level 0; 0 takes it from the first frames");
  t.key("datum", &Map::datum, choices<DatumChoice>({"auto", "ellipsoid", "geoid", "home", "unknown"}),
        "what heights are counted from; auto takes what the flight says");
  t.key("geoid_model", &Map::geoid_model, "geoid grid for datum geoid");
  t.key("max_footprint_heights", &Map::max_footprint_heights, Range{1, 1000},
        "a frame whose footprint is longer than this many times its height is refused")
      .live();
  return t.take();
}

SectionInfo describeSweep() {
  SectionTable t("sweep", &Settings::sweep, "Elevation and orthophoto from frames.");
  t.key("images", &Sweep::images, Range{2, 14}, "frames matched per tile; more is better and slower").live();
  t.key("window", &Sweep::window, {3, 5, 7, 9, 11, 13, 15}, "side of the support window, in texels").live();
  t.key("cost", &Sweep::cost, choices<MatchingCost>({"sad", "ssd", "zncc", "census"}),
        "matching cost; zncc and census do not mind changes of exposure")
      .live();
  t.key("better_half", &Sweep::better_half,
        "counts only the better half of the frames at each texel and height")
      .live();
  t.key("planes", &Sweep::planes, Range{8, 1024},
        "most heights tried on the coarsest grid; a taller range is searched in wider steps")
      .live();
  t.key("levels", &Sweep::levels, Range{1, 8}, "levels of the coarse-to-fine search").live();
  t.key("regularise", &Sweep::regularise, Range{0, 1},
        "how much neighbours must agree on the coarsest grid; 0 switches it off")
      .live();
  t.key("working_scale", &Sweep::working_scale, Range{0.1, 1},
        "share of the frames' resolution at which heights are measured; rounded to a power of two")
      .live();
  t.key("min_confidence", &Sweep::min_confidence, Range{0, 1},
        "texels below this matching confidence are not measured")
      .live();
  t.key("min_parallax_deg", &Sweep::min_parallax_deg, Range{0, 90},
        "parallax angle below which a pair of frames is not chosen")
      .live();
  t.key("max_parallax_deg", &Sweep::max_parallax_deg, Range{1, 180},
        "parallax angle beyond which a pair of frames is not chosen")
      .live();
  t.key("search_above_m", &Sweep::search_above_m, Range{0, 9000},
        "how far above the expected ground is searched; 0 goes by the height of flight")
      .live();
  t.key("search_below_m", &Sweep::search_below_m, Range{0, 9000},
        "how far below the expected ground is searched; 0 goes by the height of flight")
      .live();
  t.key("prefer", &Sweep::prefer, choices<Prefer>({"best", "latest", "max_age"}),
        "which frames win where there are more than enough: the best seen, the latest, or the best of the "
        "last max_age_s")
      .live();
  t.key("max_age_s", &Sweep::max_age_s, Range{0, kMany},
        "with prefer max_age: how much older than the newest frame of a place another may be")
      .live();
  t.key("fallback", &Sweep::fallback,
        choices<Fallback>({"image_centre", "blend", "average", "overwrite", "lowest_cost"}),
        "which of several frames colours a place without a height: the one that sees it nearest to its "
        "centre, "
        "all less towards their borders, all alike, the last, or the one that differs least from the others")
      .live();
  t.key("fill", &Sweep::fill, "fills small holes from their surroundings; filled texels are marked so")
      .live();
  return t.take();
}

SectionInfo describeClipmap() {
  SectionTable t("clipmap", &Settings::clipmap, "The pyramid of tiles and when a tile is made again.");
  t.key("update_gain", &Clipmap::update_gain, Range{0, 10},
        "a tile is made again when its views tell so much more than those that it was made from (0.8: 80 %); "
        "higher saves work")
      .live();
  t.key("max_wait_s", &Clipmap::max_wait_s, Range{0, 3600},
        "a tile that has never been swept waits no longer than this for more views after the last one")
      .live();
  t.key("settle_s", &Clipmap::settle_s, Range{0, 3600},
        "the same for a tile that is to be swept once more, while there is more urgent work")
      .live();
  t.key("max_updates_per_s", &Clipmap::max_updates_per_s, Range{0, 1e6}, "limit on tile updates; 0 is none")
      .live();
  t.key("ram_mb", &Clipmap::ram_mb, Range{16, 1e6}, "memory for the tiles that their parents are made from")
      .live();
  return t.take();
}

SectionInfo describeStore() {
  SectionTable t("store", &Settings::store, "The tile store on disk.");
  t.key("color_codec", &Store::color_codec, choices<ColorCodec>({"jpeg", "webp"}),
        "how colour tiles are coded; a tile with holes is webp in any case")
      .live();
  t.key("color_quality", &Store::color_quality, Range{1, 100}, "quality of colour tiles").live();
  t.key("elevation_step_m", &Store::elevation_step_m, Range{0.0001, 1},
        "step to which served elevation is rounded");
  t.key("disk_budget_mb", &Store::disk_budget_mb, Range{0, kMany},
        "most that a mission's map and images may take: beyond it images of mapped frames are removed, those "
        "that other frames cover best first; 0 is no limit")
      .live();
  t.key("min_free_mb", &Store::min_free_mb, Range{0, kMany}, "mapping pauses when the disk has less left")
      .live();
  return t.take();
}

SectionInfo describeLink() {
  SectionTable t("link", &Settings::link, "The HTTP link over which the ground pulls the map.");
  t.key("enabled", &Link::enabled, "serves the map");
  t.key("listen", &Link::listen, "address to listen on; 0.0.0.0 or :: for all");
  t.key("port", &Link::port, Range{0, 65535}, "TCP port; 0 lets the system choose");
  t.key("max_kbps", &Link::max_kbps, Range{0, kMany},
        "cap on what is sent in all, in kilobits per second; 0 is none")
      .live();
  t.key("max_connections", &Link::max_connections, Range{1, 10000}, "connections at a time");
  t.key("max_request_kb", &Link::max_request_kb, Range{1, 65536}, "largest request body");
  t.key("header_timeout_s", &Link::header_timeout_s, Range{1, 3600},
        "time in which a client must have asked");
  t.key("send_timeout_s", &Link::send_timeout_s, Range{1, 3600},
        "time without progress after which a slow client is dropped");
  t.key("require_token", &Link::require_token, "asks for a bearer token beyond loopback");
  t.key("token_file", &Link::token_file, "file with the tokens; made by `overfly token new`, mode 0600");
  t.key("tls_certificate", &Link::tls_certificate, "certificate chain in PEM; empty serves plain HTTP");
  t.key("tls_key", &Link::tls_key, "key of the certificate in PEM");
  t.key("allowed_origins", &Link::allowed_origins, "web origins whose pages may read the map (CORS)").live();
  return t.take();
}

SectionInfo describePreview() {
  SectionTable t("preview", &Settings::preview, "Perspective views of the map, drawn on board.");
  t.key("enabled", &Preview::enabled, "draws previews when they are asked for");
  t.key("gpu_share", &Preview::gpu_share, Range{0, 1}, "share of the GPU's time that previews may take")
      .live();
  t.key("max_width_px", &Preview::max_width_px, Range{16, 8192}, "widest picture");
  t.key("max_height_px", &Preview::max_height_px, Range{16, 8192}, "highest picture");
  t.key("max_rate_fps", &Preview::max_rate_fps, Range{0.1, 60}, "pictures per second and client").live();
  t.key("cache_mb", &Preview::cache_mb, Range{16, 1e6}, "GPU memory for the clipmap's textures");
  t.key("jpeg_quality", &Preview::jpeg_quality, Range{1, 100}, "quality of the pictures").live();
  return t.take();
}

SectionInfo describeQuality() {
  SectionTable t("quality", &Settings::quality, "Accuracy against time.");
  t.key("mode", &Quality::mode, choices<QualityMode>({"realtime", "balanced", "best"}),
        "realtime keeps up at any price, best takes the time that it needs, balanced is in between")
      .live();
  t.key("latency_s", &Quality::latency_s, Range{0, 3600},
        "aimed time from exposure to tile; 0 leaves it to the mode")
      .live();
  t.key("gpu_share", &Quality::gpu_share, Range{0, 1},
        "share of the GPU's time for mapping; 0 leaves it to the mode")
      .live();
  t.key("ms_per_tile", &Quality::ms_per_tile, Range{0, 60000}, "GPU time per tile; 0 leaves it to the mode")
      .live();
  return t.take();
}

SectionInfo describeAdjust() {
  SectionTable t("adjust", &Settings::adjust, "Pose adjustment in flight.");
  t.key("mode", &Adjust::mode, choices<AdjustMode>({"off", "auto", "always"}),
        "auto leaves poses alone that came adjusted, always starts from what the device recorded, off takes "
        "every pose as it comes");
  t.key("window_frames", &Adjust::window_frames, Range{3, 500},
        "newest frames that are adjusted together with each new one");
  t.key("memory_frames", &Adjust::memory_frames, Range{50, 10000},
        "frames whose features are kept for later legs and the adjustment after landing, 1.5 MB each");
  t.key("features", &Adjust::features, Range{100, 20000}, "features kept per frame");
  t.key("max_reprojection_px", &Adjust::max_reprojection_px, Range{0.1, 50},
        "matches that fit worse are dropped");
  t.key("max_wait_s", &Adjust::max_wait_s, Range{0, 3600},
        "a frame waits at most so long for its neighbours before it is mapped");
  t.key("remake_px", &Adjust::remake_px, Range{0.1, 100},
        "a frame that moves by more than this on the ground is mapped again");
  t.key("keep_profile", &Adjust::keep_profile,
        "a calibrated lens is kept beside the missions, and the next flight starts from it");
  return t.take();
}

SectionInfo describeLog() {
  SectionTable t("log", &Settings::log, "Messages.");
  t.key("level", &Log::level, choices<LogLevel>({"trace", "debug", "info", "warning", "error"}),
        "least level that is written")
      .live();
  return t.take();
}

SectionInfo describeGpu() {
  SectionTable t("gpu", &Settings::gpu, "The GPU.");
  t.key(
      "device", &Gpu::device,
      "which GPU, where there are several: its number or a part of its name as `overfly doctor --all` prints "
      "them, or its render node (/dev/dri/renderD128); empty takes the first that works");
  t.key("software", &Gpu::software, "uses Mesa's software rasteriser even where there is a GPU");
  t.key("frame_cache_mb", &Gpu::frame_cache_mb, Range{16, 1e6}, "GPU memory for rectified frames").live();
  return t.take();
}

SectionInfo describePlan() {
  SectionTable t("plan", &Settings::plan, "The area that the flight is to cover.");
  t.key("area_file", &Plan::area_file, "GeoJSON polygon; empty for none").live();
  t.key("min_views", &Plan::min_views, Range{1, 100},
        "frames that must see a place for it to count as covered")
      .live();
  return t.take();
}

}  // namespace

std::span<const SectionInfo> description() {
  static const std::vector<SectionInfo> sections = {
      describeSource(), describeCamera(),  describeGpio(),    describePose(),    describeMission(),
      describeRecord(), describeMap(),     describeSweep(),   describeClipmap(), describeStore(),
      describeLink(),   describePreview(), describeQuality(), describeAdjust(),  describeLog(),
      describeGpu(),    describePlan()};
  return sections;
}

}  // namespace overfly::config
