#pragma once
#include <array>
#include <filesystem>
#include <string>
#include <vector>

// The settings, one struct per section, defaults beside the fields. What each key means to a person, its
// range and whether it may change while the daemon runs stands in config/description.cpp; the loader, the
// checks, the sample file, the environment and --set all come from there. Plain values; the unit is in the
// name.
namespace overfly::config {

enum class SourceKind { Replay, Scene, V4l2, Libcamera };
struct Source {
  SourceKind kind = SourceKind::Replay;
  std::string path;  // flight folder, scene file, device node or libcamera id, after `kind`
  double speed = 1;  // 0: as fast as the consumer takes them
  bool loop = false;
  int start_frame = 0;
  double retry_s = 2;
};

enum class CameraFormat { Auto, Mjpeg, Nv12, Yuyv, Grey, Rgb, Bayer8, Bayer10 };
struct Camera {
  std::string id = "cam0";
  std::filesystem::path
      model_file;    // empty: from the flight or the frames' own tags; needed by a live camera
  int width_px = 0;  // 0: the camera's largest
  int height_px = 0;
  double rate_fps = 0;  // 0: the camera's own
  CameraFormat format = CameraFormat::Auto;
  int exposure_us = 0;            // 0: automatic
  double gain = 0;                // linear (v4l2: as the driver counts); 0: automatic
  double lens_position_dpt = 0;   // dioptres; 0: infinity
  double rolling_shutter_ms = 0;  // first row to last row; 0: global shutter
  int buffers = 6;
};

enum class GpioEdge { Rising, Falling };
struct Gpio {
  std::string chip;        // empty: no stamps from GPIO
  int exposure_line = -1;  // -1: not wired
  GpioEdge exposure_edge = GpioEdge::Rising;
  int pps_line = -1;
  GpioEdge pps_edge = GpioEdge::Rising;
  int debounce_us = 200;
  double expected_lag_ms = 0;
  int trigger_line = -1;  // -1: none
  int trigger_interval_ms = 1000;
  int trigger_width_us = 1000;
};

enum class PoseAttitude { Auto, Body, Gimbal };
enum class PoseHeight { Auto, Ellipsoid, Msl, Home };
enum class PosePulses { Auto, None, Gpio, Trigger, Feedback };
struct PoseSettings {
  std::string mavlink;  // empty: no autopilot
  int system_id = 1;
  int component_id = 100;
  std::filesystem::path signing_key;  // empty: nothing is signed
  bool request_streams = true;
  PoseAttitude attitude = PoseAttitude::Auto;
  PoseHeight height = PoseHeight::Auto;
  PosePulses pulses = PosePulses::Auto;
  int max_gap_ms = 500;
  int max_wait_ms = 1000;
  double max_tilt_deg = 60;
  std::array<double, 3> lever_arm_m{0, 0, 0};    // camera minus antenna, in body axes (forward, right, down)
  std::array<double, 3> boresight_deg{0, 0, 0};  // roll, pitch, yaw from the body's to the camera's mount
  double delay_ms = 0;                           // pose time = frame time + delay
  double position_sigma_m = 0;                   // 0: what the source says
  double attitude_sigma_deg = 0;
};

enum class MissionStart { Boot, Arming, Command };
struct Mission {
  MissionStart start = MissionStart::Boot;
};

struct Record {
  bool raw_inputs = true;
  int min_free_mb = 1024;
};

enum class DatumChoice { Auto, Ellipsoid, Geoid, Home, Unknown };
struct Map {
  std::filesystem::path folder = "/var/lib/overfly/map";
  int tile_size = 256;                  // texels a side
  std::string lattice = "webmercator";  // TileLattice's text; utm, ups and local may lack their origin
  double gsd_m = 0;                     // 0: from the first frames
  DatumChoice datum = DatumChoice::Auto;
  std::string geoid_model = "egm96_15";
  double max_footprint_heights = 10;  // longest footprint side, in heights above ground
};

enum class MatchingCost { Sad, Ssd, Zncc, Census };
enum class Prefer { Best, Latest, MaxAge };
enum class Fallback { ImageCentre, Blend, Average, Overwrite, LowestCost };
struct Sweep {
  int images = 12;
  int window = 7;
  MatchingCost cost = MatchingCost::Zncc;
  bool better_half = false;
  int planes = 256;  // on the coarsest grid
  int levels = 4;
  double regularise = 0;        // 0..1
  double working_scale = 1;     // of the frames' resolution
  double min_confidence = 0.2;  // 0..1
  double max_parallax_deg = 50;
  double min_parallax_deg = 1.2;
  double search_above_m = 0;  // around the ground that is expected; 0: by the height of flight
  double search_below_m = 0;
  Prefer prefer = Prefer::Best;
  double max_age_s = 0;  // for MaxAge
  bool fill = true;
  Fallback fallback = Fallback::ImageCentre;
};

struct Clipmap {
  double update_gain = 0.8;  // growth of what the views tell that is worth another sweep
  double max_wait_s = 5;
  double settle_s = 40;
  double max_updates_per_s = 0;  // 0: no limit
  int ram_mb = 256;
};

enum class ColorCodec { Jpeg, Webp };
struct Store {
  ColorCodec color_codec = ColorCodec::Jpeg;
  int color_quality = 85;
  double elevation_step_m = 0.01;
  int disk_budget_mb = 0;  // 0: until the disk is nearly full
  int min_free_mb = 512;
};

struct Link {
  bool enabled = true;
  std::string listen = "127.0.0.1";
  int port = 8420;
  int max_kbps = 0;  // 0: no cap
  int max_connections = 1024;
  int max_request_kb = 64;
  double header_timeout_s = 10;
  double send_timeout_s = 60;
  bool require_token = true;
  std::filesystem::path token_file = "/var/lib/overfly/token";
  std::filesystem::path tls_certificate;
  std::filesystem::path tls_key;
  std::vector<std::string> allowed_origins;
};

struct Preview {
  bool enabled = true;
  double gpu_share = 0.2;
  int max_width_px = 1280;
  int max_height_px = 720;
  double max_rate_fps = 10;
  int cache_mb = 128;
  int jpeg_quality = 80;
};

enum class QualityMode { Realtime, Balanced, Best };
struct Quality {
  QualityMode mode = QualityMode::Balanced;
  double latency_s = 0;  // 0: what the mode says
  double gpu_share = 0;
  double ms_per_tile = 0;
};

enum class AdjustMode { Off, Auto, Always };
struct Adjust {
  AdjustMode mode = AdjustMode::Auto;
  int window_frames = 8;
  int memory_frames = 250;
  int features = 2500;
  double max_reprojection_px = 4;
  double max_wait_s = 10;
  double remake_px = 2;
  bool keep_profile = true;
};

enum class LogLevel { Trace, Debug, Info, Warning, Error };
struct Log {
  LogLevel level = LogLevel::Info;
};

struct Gpu {
  std::string device;  // empty: the first that works
  bool software = false;
  int frame_cache_mb = 768;
};

struct Plan {
  std::filesystem::path area_file;
  int min_views = 5;
};

struct Settings {
  Source source;
  Camera camera;
  Gpio gpio;
  PoseSettings pose;
  Mission mission;
  Record record;
  Map map;
  Sweep sweep;
  Clipmap clipmap;
  Store store;
  Link link;
  Preview preview;
  Quality quality;
  Adjust adjust;
  Log log;
  Gpu gpu;
  Plan plan;
};

}  // namespace overfly::config
