#include "tiling/adjust/flight_adjust.h"

#include <algorithm>
#include <map>
#include <utility>

#include "capture/image_decode.h"
#include "tiling/adjust/telemetry_prior.h"

namespace overfly::tiling::adjust {
Result<FlightAdjustment> adjustFlight(const capture::Flight& flight, const FlightAdjustOptions& options) {
  const auto& source = flight.frames();
  std::vector<TelemetryPrior> priors = priorsFromTelemetry(source);
  std::vector<FlightAdjustment::FrameResult> results(source.size());
  std::map<std::string, std::vector<std::size_t>> by_camera;
  for (std::size_t i = 0; i < source.size(); ++i) {
    results[i].index = i;
    results[i].pose.id = i;
    results[i].pose.state = FrameState::HeldBack;
    results[i].assumed = priors[i].assumed;
    if (!priors[i].pose && source[i].frame.pose) {
      priors[i].pose = source[i].frame.pose;
      fillCovariance(*priors[i].pose);
    }
    if (!priors[i].pose) {
      results[i].pose.reason = "no position was recorded";
      continue;
    }
    by_camera[source[i].frame.camera_id].push_back(i);
  }
  if (by_camera.empty()) return fail(ErrorCode::BadInput, "no frame of the flight has a position");

  std::vector<capture::FlightCamera> cameras = flight.cameras();
  std::vector<CameraAdjustment> adjustments;
  std::vector<capture::FlightFrame> frames = source;
  std::size_t done = 0, read = 0;
  for (const auto& [camera_id, members] : by_camera) {
    CameraAdjustment adjustment;
    adjustment.camera_id = camera_id;
    adjustment.nominal = source[members.front()].frame.camera;
    AdjusterOptions adjuster_options = options.adjuster;
    adjuster_options.map.retained_frames = static_cast<int>(members.size()) + 1;
    Adjuster adjuster(adjustment.nominal, adjuster_options);
    std::map<std::string, FrameId> by_name;
    for (const std::size_t i : members) {
      const auto frame = flight.load(i);
      const auto grey = frame ? capture::decodeImage((*frame)->image, capture::PixelFormat::Grey8)
                              : Result<capture::Image>(tl::unexpected(frame.error()));
      if (!grey) {
        results[i].pose.reason = grey.error().message;
      } else if (const auto added = adjuster.addFrame(
                     i, {grey->bytes.data(), grey->width, grey->height, grey->stride}, *priors[i].pose);
                 !added) {
        results[i].pose.reason = added.error().message;
      } else {
        by_name[source[i].frame.name] = i;
        ++read;
      }
      if (options.progress) options.progress(++done, source[i].frame.name);
    }
    for (const auto& entry : options.control) {
      Adjuster::ControlPoint point{entry.name, entry.place, entry.sigma_m, entry.check, {}};
      for (const auto& mark : entry.marks)
        if (const auto it = by_name.find(mark.image); it != by_name.end())
          point.seen.emplace_back(it->second, mark.pixel);
      adjuster.addControl(point);
    }
    for (auto& pose : adjuster.adjustAll()) results[pose.id].pose = std::move(pose);
    adjustment.adjusted = adjuster.camera();
    adjustment.summary = adjuster.summary();
    adjustment.control = adjuster.controlResiduals();
    for (auto& camera : cameras)
      if (camera.id == camera_id) camera.model = adjustment.adjusted;
    for (const std::size_t i : members) {
      auto& frame = frames[i].frame;
      frame.camera = adjustment.adjusted;
      frame.pose_is_adjusted = results[i].pose.state == FrameState::Adjusted;
      frame.pose.reset();
      if (frame.pose_is_adjusted || results[i].pose.state == FrameState::PriorOnly)
        frame.pose = results[i].pose.pose;
    }
    adjustments.push_back(std::move(adjustment));
  }
  if (read == 0) return fail(ErrorCode::BadInput, "no frame of the flight has a picture that can be read");
  auto info = flight.info();
  info.notes.emplace_back("poses and lens adjusted by overfly adjust");
  return FlightAdjustment{std::move(results), std::move(adjustments),
                          capture::Flight(std::move(info), std::move(cameras), std::move(frames),
                                          flight.warnings(), flight.skipped())};
}

}  // namespace overfly::tiling::adjust
