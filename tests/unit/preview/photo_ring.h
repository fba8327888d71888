#pragma once
#include <cmath>
#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

#include "render/preview/projector.h"

namespace overfly::test {

// Photographs of known content from known places: every view of theirs gets all of them.
class PhotoRing : public preview::ProjectorSource {
 public:
  // Colour at (u, v), from 0 to 1 over photograph `index`.
  struct Rgb {
    std::uint8_t r, g, b;
  };
  using Paint = std::function<Rgb(double u, double v, std::size_t index)>;
  PhotoRing(std::vector<preview::View> cameras, Paint paint)
      : cameras_(std::move(cameras)), paint_(std::move(paint)) {}

  Result<std::vector<preview::Projector>> choose(const preview::ProjectorQuery& query) override {
    last = query;
    std::vector<preview::Projector> out;
    for (std::size_t i = 0; i < cameras_.size() && out.size() < static_cast<std::size_t>(query.count); ++i) {
      const geo::LocalFrame local(cameras_[i].position);
      preview::Projector projector;
      projector.id = i + 1;
      projector.position_in_ecef = geo::ecefFromGeodetic(cameras_[i].position);
      projector.ecef_from_camera = Eigen::Quaterniond(
          Eigen::Matrix3d(local.enuFromEcefRotation().transpose() * cameras_[i].enuFromCamera()));
      out.push_back(projector);
    }
    return out;
  }
  Result<preview::ProjectorImage> load(std::uint64_t id, int width, int height) override {
    if (reading) return fail(ErrorCode::Unavailable, "being read");
    ++loads;
    const preview::View& camera = cameras_[id - 1];
    preview::ProjectorImage out;
    out.pinhole.width = width;
    out.pinhole.height = height;
    out.pinhole.fx = camera.focal() * width / camera.width;
    out.pinhole.fy = camera.focal() * height / camera.height;
    out.pinhole.cx = 0.5 * width;
    out.pinhole.cy = 0.5 * height;
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const Rgb c = paint_((x + 0.5) / width, (y + 0.5) / height, id - 1);
        out.rgba.insert(out.rgba.end(), {c.r, c.g, c.b, 255});
      }
    }
    return out;
  }
  [[nodiscard]] const std::vector<preview::View>& cameras() const { return cameras_; }

  preview::ProjectorQuery last;
  int loads = 0;
  bool reading = false;  // no picture is there yet

 private:
  std::vector<preview::View> cameras_;
  Paint paint_;
};

}  // namespace overfly::test
