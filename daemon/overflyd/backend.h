#pragma once
#include <string>

#include "daemon/link/link_server.h"
#include "daemon/overflyd/missions.h"
#include "daemon/overflyd/onboard_view.h"

namespace overfly::daemon {

// What the link asks, answered from the missions. Thread-safe. `missions` and `view` must outlive the link.
class Backend final : public link::LinkBackend {
 public:
  Backend(Missions& missions, OnboardView& view) : missions_(missions), view_(view) {}

  [[nodiscard]] std::vector<link::Mission> missions() const override;
  [[nodiscard]] std::string statusJson() const override;
  [[nodiscard]] Result<std::string> frontJson() const override;
  [[nodiscard]] std::string metricsText() const override;
  [[nodiscard]] link::Health health() const override;
  void interest(const geo::TileKey& key) override;
  [[nodiscard]] Result<link::PreviewPicture> preview(const link::Mission& mission,
                                                     const link::PreviewView& view) override {
    return view_.draw(mission.map, view);
  }
  [[nodiscard]] link::PreviewLimits previewLimits() const override { return view_.limits(); }
  [[nodiscard]] bool changesMissions() const override { return true; }
  [[nodiscard]] Result<link::Mission> startMission(const std::string& name) override;
  [[nodiscard]] Result<void> stopMission() override { return missions_.stop(); }

 private:
  // Of the mission that is shown; what a daemon without one says.
  [[nodiscard]] PipelineStatus status() const;

  Missions& missions_;
  OnboardView& view_;
};

}  // namespace overfly::daemon
