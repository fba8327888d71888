#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "render/gl/context.h"
#include "render/scene/flight_plan.h"
#include "render/scene/world.h"

namespace overfly::scene {

struct RecordOptions {
  bool live = false;  // at true speed and with this machine's clock; else as fast as frames are made
  gl::ContextOptions gpu = {};  // what renders
  std::function<void(std::size_t done, std::size_t total, const std::string& frame)> progress;
};

struct RecordedScene {
  FlightPlan plan;              // with the exact poses
  capture::CameraModel camera;  // of the frames
  double duration_s = 0;        // of the flight
  double wall_s = 0;            // that making it took
  double worst_late_s = 0;      // live: the largest delay of a frame against its time
};

// Renders a scene's flight into a new folder: a recorded flight as any other, with the exact pose of every
// frame beside it in truth.csv. An empty folder name renders and writes nothing. Errors: the source's, the
// recorder's, Io.
[[nodiscard]] Result<RecordedScene> recordScene(const std::shared_ptr<const World>& world,
                                                const std::filesystem::path& folder,
                                                const RecordOptions& options = {});

}  // namespace overfly::scene
