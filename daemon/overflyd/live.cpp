#include "daemon/overflyd/live.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "capture/geo/geodetic.h"

namespace overfly::daemon {
namespace {

using Json = nlohmann::json;

std::int64_t ns(double milliseconds) { return static_cast<std::int64_t>(milliseconds * 1e6); }

capture::PulsesFrom pulsesFrom(const config::Settings& settings) {
  switch (settings.pose.pulses) {
    case config::PosePulses::Auto:
      return settings.gpio.exposure_line >= 0 && !settings.gpio.chip.empty() ? capture::PulsesFrom::Gpio
                                                                             : capture::PulsesFrom::None;
    case config::PosePulses::None:
      return capture::PulsesFrom::None;
    case config::PosePulses::Gpio:
      return capture::PulsesFrom::Gpio;
    case config::PosePulses::Trigger:
      return capture::PulsesFrom::Trigger;
    case config::PosePulses::Feedback:
      return capture::PulsesFrom::Feedback;
  }
  return capture::PulsesFrom::None;
}

Result<capture::AutopilotOptions> autopilotOptions(const config::Settings& settings) {
  const config::PoseSettings& pose = settings.pose;
  capture::AutopilotOptions options;
  options.component_id = static_cast<std::uint8_t>(pose.component_id);
  options.request_streams = pose.request_streams;
  options.track.max_gap_ns = ns(pose.max_gap_ms);
  capture::TelemetryOptions& telemetry = options.telemetry;
  telemetry.autopilot = {static_cast<std::uint8_t>(pose.system_id), 1};
  telemetry.attitude = static_cast<capture::AttitudeFrom>(pose.attitude);
  telemetry.height = static_cast<capture::HeightFrom>(pose.height);
  if (auto geoid = geo::Geoid::load(fmt::format("/usr/share/proj/{}.gtx", settings.map.geoid_model)))
    telemetry.geoid = std::move(*geoid);
  telemetry.lever_arm_in_body = {pose.lever_arm_m[0], pose.lever_arm_m[1], pose.lever_arm_m[2]};
  telemetry.position_sigma_m = pose.position_sigma_m;
  telemetry.attitude_sigma = geo::radians(pose.attitude_sigma_deg);
  telemetry.max_gap_ns = options.track.max_gap_ns;
  if (!pose.signing_key.empty()) {
    auto key = mavlink::readKey(pose.signing_key);
    if (!key) return fail(ErrorCode::BadSettings, "pose.signing_key: " + key.error().message);
    options.key = *key;
  }
  return options;
}

}  // namespace

Result<std::unique_ptr<capture::FrameSource>> makeLive(const config::Settings& settings,
                                                       std::unique_ptr<capture::CameraSource> camera) {
  capture::LiveOptions options;
  options.mount.body_from_camera = capture::bodyFromCamera(geo::radians(settings.pose.boresight_deg[0]),
                                                           geo::radians(settings.pose.boresight_deg[1]),
                                                           geo::radians(settings.pose.boresight_deg[2]));
  options.mount.delay_ns = ns(settings.pose.delay_ms);
  options.max_wait_ns = ns(settings.pose.max_wait_ms);
  options.rolling_shutter_ns = ns(settings.camera.rolling_shutter_ms);
  options.pulses = pulsesFrom(settings);
  options.matcher.expected_lag_ns = ns(settings.gpio.expected_lag_ms);

  capture::LiveSource::Parts parts;
  parts.camera = std::move(camera);
  if (!settings.pose.mavlink.empty()) {
    auto transport = capture::makeTransport(settings.pose.mavlink);
    if (!transport) return tl::unexpected(transport.error());
    auto autopilot = autopilotOptions(settings);
    if (!autopilot) return tl::unexpected(autopilot.error());
    // std::function copies what it holds, and a transport is one of a kind.
    parts.autopilot = [transport =
                           std::make_shared<std::unique_ptr<capture::Transport>>(std::move(*transport)),
                       made = std::move(*autopilot)](capture::Autopilot::Listeners listeners) {
      return std::make_unique<capture::Autopilot>(std::move(*transport), made, std::move(listeners));
    };
  }
  const config::Gpio& gpio = settings.gpio;
  const bool wired = gpio.exposure_line >= 0 || gpio.pps_line >= 0 || gpio.trigger_line >= 0;
  if (gpio.chip.empty() && (wired || options.pulses == capture::PulsesFrom::Gpio))
    return fail(ErrorCode::BadSettings, "gpio.chip is empty: name the chip of the lines, as in gpiochip0");
  if (options.pulses == capture::PulsesFrom::Gpio && gpio.exposure_line < 0)
    return fail(ErrorCode::BadSettings, "gpio.exposure_line: pose.pulses is gpio and no line is given");
  if (gpio.exposure_line >= 0 || gpio.pps_line >= 0) {
    capture::GpioStampsOptions stamps;
    stamps.chip = gpio.chip;
    stamps.debounce_ns = std::int64_t{gpio.debounce_us} * 1000;
    if (gpio.exposure_line >= 0)
      stamps.exposure = {static_cast<unsigned>(gpio.exposure_line),
                         gpio.exposure_edge == config::GpioEdge::Rising};
    if (gpio.pps_line >= 0)
      stamps.pps = {static_cast<unsigned>(gpio.pps_line), gpio.pps_edge == config::GpioEdge::Rising};
    parts.gpio = [stamps](capture::GpioStamps::Listeners listeners) {
      return std::make_unique<capture::GpioStamps>(stamps, std::move(listeners));
    };
  }
  if (gpio.trigger_line >= 0) {
    capture::TriggerOptions trigger;
    trigger.chip = gpio.chip;
    trigger.line = static_cast<unsigned>(gpio.trigger_line);
    trigger.interval = std::chrono::milliseconds(gpio.trigger_interval_ms);
    trigger.width = std::chrono::microseconds(gpio.trigger_width_us);
    parts.trigger = std::make_unique<capture::TriggerOutput>(trigger);
  }
  return std::make_unique<capture::LiveSource>(std::move(parts), options);
}

Json liveJson(const capture::LiveStatus& s) {
  Json json{{"camera",
             {{"present", s.camera.present},
              {"problem", s.camera.problem},
              {"model", s.camera.model},
              {"frames", s.camera.frames},
              {"dropped", s.camera.dropped},
              {"reconnects", s.camera.reconnects},
              {"errors", s.camera.errors}}},
            {"poses", {{"with", s.with_pose}, {"without", s.without_pose}, {"came_later", s.late_poses}}}};
  if (s.autopilot) {
    const capture::AutopilotStatus& a = *s.autopilot;
    const capture::TelemetryStatus& t = a.telemetry;
    json["autopilot"] = {{"state", capture::nameOf(a.state)},
                         {"link", a.link},
                         {"problem", a.problem},
                         {"armed", a.armed},
                         {"packets",
                          {{"good", a.packets.packets},
                           {"bad", a.packets.bad},
                           {"lost", a.packets.lost},
                           {"unknown", a.packets.unknown},
                           {"skipped_bytes", a.packets.skipped}}},
                         {"events", a.events},
                         {"poses", t.poses},
                         {"dropped", t.dropped},
                         {"position", t.position},
                         {"attitude", t.attitude},
                         {"fix_type", t.fix_type},
                         {"heights", t.height_reason},
                         {"clock",
                          {{"sigma_s", t.clock_sigma_s},
                           {"drift_ppm", t.clock_drift_ppm},
                           {"by", t.clock_paired ? "timesync" : "arrivals"},
                           {"jumps", t.clock.jumps},
                           {"outliers", t.clock.outliers}}}};
  }
  if (s.gpio) {
    json["gpio"] = {{"open", s.gpio->open},           {"problem", s.gpio->problem},
                    {"exposures", s.gpio->exposures}, {"pps", s.gpio->pps},
                    {"bounced", s.gpio->bounced},     {"reopened", s.gpio->reopened},
                    {"problems", s.gpio->problems}};
  }
  if (s.trigger) {
    json["trigger"] = {{"problem", s.trigger->problem},
                       {"pulses", s.trigger->pulses},
                       {"worst_late_s", static_cast<double>(s.trigger->worst_late_ns) * 1e-9}};
  }
  if (s.pulses.pulses > 0) {
    json["pulses"] = {{"seen", s.pulses.pulses},
                      {"matched", s.pulses.matched},
                      {"frames_without", s.pulses.frames_without},
                      {"spurious", s.pulses.spurious}};
    if (s.lag) {
      json["pulses"]["lag_s"] = static_cast<double>(s.lag->ns) * 1e-9;
      json["pulses"]["lag_sigma_s"] = static_cast<double>(s.lag->sigma_ns) * 1e-9;
      json["pulses"]["ambiguous"] = s.lag->ambiguous;
    }
  }
  if (s.utc_offset_ns) json["utc"] = {{"sigma_s", static_cast<double>(s.utc_sigma_ns) * 1e-9}};
  return json;
}

std::string liveMetrics(const capture::LiveStatus& s) {
  std::string text;
  const auto metric = [&](const char* name, const char* kind, const char* help, double value) {
    text += fmt::format("# HELP {0} {1}\n# TYPE {0} {2}\n{0} {3}\n", name, help, kind, value);
  };
  metric("overfly_camera_frames_total", "counter", "frames from the camera",
         static_cast<double>(s.camera.frames));
  metric("overfly_camera_dropped_total", "counter", "exposures that the camera did not hand out",
         static_cast<double>(s.camera.dropped));
  metric("overfly_frames_with_pose_total", "counter", "frames that had a pose in time",
         static_cast<double>(s.with_pose));
  metric("overfly_late_poses_total", "counter", "poses that came after their frames",
         static_cast<double>(s.late_poses));
  if (s.autopilot) {
    metric("overfly_autopilot_talking", "gauge", "1 while the autopilot is heard",
           s.autopilot->state == capture::AutopilotState::Talking ? 1 : 0);
    metric("overfly_mavlink_packets_total", "counter", "MAVLink packets with a right checksum",
           static_cast<double>(s.autopilot->packets.packets));
    metric("overfly_mavlink_lost_total", "counter", "MAVLink packets lost on the way",
           static_cast<double>(s.autopilot->packets.lost));
    metric("overfly_poses_total", "counter", "poses from the autopilot",
           static_cast<double>(s.autopilot->telemetry.poses));
    metric("overfly_autopilot_clock_sigma_seconds", "gauge", "1 sigma of the autopilot's clock against ours",
           s.autopilot->telemetry.clock_sigma_s);
  }
  if (s.pulses.pulses > 0) {
    metric("overfly_pulses_matched_total", "counter", "frames stamped by a pulse",
           static_cast<double>(s.pulses.matched));
    metric("overfly_pulses_missing_total", "counter", "frames for which no pulse was sure",
           static_cast<double>(s.pulses.frames_without));
  }
  return text;
}

}  // namespace overfly::daemon
