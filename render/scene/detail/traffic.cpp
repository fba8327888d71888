#include "render/scene/detail/traffic.h"

#include <Eigen/Geometry>
#include <cmath>
#include <limits>

#include "render/scene/detail/settlement.h"
#include "render/scene/random.h"

namespace overfly::scene {

Mesh Traffic::meshAt(double time_s) const {
  SolidBuilder cars;
  std::uint32_t street_number = 0;
  for (const StreetDescription& street : world_.description.streets) {
    ++street_number;
    double length = 0;
    for (std::size_t i = 0; i + 1 < street.points.size(); ++i)
      length += (street.points[i + 1] - street.points[i]).norm();
    const auto count = static_cast<std::uint32_t>(std::lround(settings_["per_kilometre"] * length / 1000));
    for (std::uint32_t car = 0; car < count; ++car) {
      const std::uint32_t number = hashOf(settings_.seed, street_number, car);
      const bool back = (car & 1u) != 0;
      double along = std::fmod(
          length * (car + 0.8 * uniform(number, 1)) / count + settings_["speed_mps"] * time_s, length);
      if (back) along = length - along;
      for (std::size_t i = 0; i + 1 < street.points.size(); ++i) {
        const Eigen::Vector2d d = street.points[i + 1] - street.points[i];
        if (along > d.norm() && i + 2 < street.points.size()) {
          along -= d.norm();
          continue;
        }
        const Eigen::Vector2d forward = (back ? -1.0 : 1.0) * d.normalized(),
                              right(forward.y(), -forward.x());
        const Eigen::Vector2d p = street.points[i] + along * d.normalized() + 0.25 * street.width * right;
        buildCar(cars, p, std::atan2(forward.y(), forward.x()), world_.terrain.heightAt(p.x(), p.y()),
                 number & 0xffff);
        break;
      }
    }
  }
  return std::move(cars).finish(std::numeric_limits<double>::max());
}

}  // namespace overfly::scene
