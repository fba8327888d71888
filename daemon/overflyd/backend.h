#pragma once
#include <string>

#include "daemon/link/link_server.h"
#include "daemon/overflyd/pipeline.h"

namespace overfly::daemon {

// What the link asks, answered from the pipeline and the missions on disk. Thread-safe.
class Backend final : public link::LinkBackend {
 public:
  // `root`: the folder of all missions; `mission`: the current one's name. The pipeline must outlive the
  // link.
  Backend(std::filesystem::path root, std::string mission, Pipeline& pipeline)
      : root_(std::move(root)), mission_(std::move(mission)), pipeline_(pipeline) {}

  [[nodiscard]] std::vector<link::Mission> missions() const override;
  [[nodiscard]] std::string statusJson() const override;
  [[nodiscard]] std::string metricsText() const override;
  [[nodiscard]] link::Health health() const override;
  void interest(const geo::TileKey& key) override { pipeline_.interest(key); }

 private:
  std::filesystem::path root_;
  std::string mission_;
  Pipeline& pipeline_;
};

// The folders below `root` that hold a map, by name.
[[nodiscard]] std::vector<std::string> missionsIn(const std::filesystem::path& root);

}  // namespace overfly::daemon
