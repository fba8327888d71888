#pragma once
#include <Eigen/Core>
#include <Eigen/LU>
#include <cmath>
#include <vector>

namespace overfly::test {

// Where the pattern lies, found by least squares on small blocks: the displacement (east, south; texels) of
// `image` against what the truth says.
template <typename Truth>
std::vector<double> shiftsOf(const std::vector<double>& image, int size, int block, const Truth& truth) {
  std::vector<double> shifts;
  for (int by = 0; by + block <= size; by += block)
    for (int bx = 0; bx + block <= size; bx += block) {
      Eigen::Vector2d shift = Eigen::Vector2d::Zero();
      bool usable = true;
      for (int iteration = 0; iteration < 4 && usable; ++iteration) {
        // Gain and offset are free: blur and exposure do not count as a shift.
        Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
        Eigen::Vector4d right = Eigen::Vector4d::Zero();
        for (int y = by; y < by + block; ++y)
          for (int x = bx; x < bx + block; ++x) {
            const double value = image[static_cast<std::size_t>(y * size + x)];
            if (std::isnan(value)) usable = false;
            const double tx = x - shift.x(), ty = y - shift.y();
            const double here = truth(tx, ty);
            const Eigen::Vector4d row(-(truth(tx + 0.5, ty) - truth(tx - 0.5, ty)),
                                      -(truth(tx, ty + 0.5) - truth(tx, ty - 0.5)), here, 1);
            normal += row * row.transpose();
            right += row * value;
          }
        const Eigen::Vector4d solution = normal.fullPivLu().solve(right);
        shift += solution.head<2>() / solution[2];
      }
      if (usable) shifts.push_back(shift.norm());
    }
  return shifts;
}

}  // namespace overfly::test
