#pragma once
#include <filesystem>
#include <memory>

#include "capture/frame_source.h"
#include "render/gl/context.h"
#include "render/scene/flight_plan.h"
#include "render/scene/world.h"

namespace overfly::scene {

struct SceneSourceOptions {
  double speed = 1;  // times true time; 0: as fast as the consumer takes frames
  bool live_clock =
      false;      // times are this machine's CLOCK_BOOTTIME from open() on; else those of a fixed day
  int ahead = 2;  // frames rendered before they are asked for; raising it costs memory
  gl::ContextOptions gpu = {};  // what renders
};

// A simulated flight as a FrameSource. A thread of its own owns the GL context and renders ahead; next()
// hands frames on at their time. Frames carry RGB pictures, or JPEG where the scene names that effect; their
// poses are exact and marked adjusted, unless the scene names an effect on the pose. Late consumers lose
// nothing.
class SceneSource final : public capture::FrameSource {
 public:
  explicit SceneSource(std::filesystem::path file_or_name, SceneSourceOptions options = {});
  explicit SceneSource(std::shared_ptr<const World> world, SceneSourceOptions options = {});
  ~SceneSource() override;

  // Unavailable: the scene's file is not there, or no OpenGL ES 3.1 can be had; BadSettings: what is wrong in
  // the file.
  [[nodiscard]] Result<void> open() override;
  [[nodiscard]] Result<capture::FramePtr> next(std::chrono::milliseconds timeout) override;
  void stop() override;
  void close() override;
  [[nodiscard]] std::string describe() const override;

  // Null before the first open().
  [[nodiscard]] std::shared_ptr<const World> world() const;
  // The flight with its exact poses; empty before the first open().
  [[nodiscard]] const FlightPlan& plan() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

// Time of a simulated flight's start when it does not run on this machine's clock: 1,000 s after boot, on
// 21 June 2026, 10:00 UTC.
inline constexpr std::int64_t kFlightStart_ns = 1'000'000'000'000;
inline constexpr std::int64_t kFlightStartUtc_ns = 1'782'036'000'000'000'000;

}  // namespace overfly::scene
