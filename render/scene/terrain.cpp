#include "render/scene/terrain.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>

#include "render/scene/random.h"

namespace overfly::scene {
namespace {

// Gradient-free value noise in double with quintic interpolation, in [-1, 1].
double valueNoise(double x, double y, std::uint32_t seed) {
  const double fx = std::floor(x), fy = std::floor(y);
  const auto ix = static_cast<std::uint32_t>(static_cast<std::int32_t>(fx));
  const auto iy = static_cast<std::uint32_t>(static_cast<std::int32_t>(fy));
  const auto eased = [](double t) { return t * t * t * (t * (6 * t - 15) + 10); };
  const double tx = eased(x - fx), ty = eased(y - fy);
  const double a = std::lerp(uniform(seed, ix, iy), uniform(seed, ix + 1, iy), tx);
  const double b = std::lerp(uniform(seed, ix, iy + 1), uniform(seed, ix + 1, iy + 1), tx);
  return 2 * std::lerp(a, b, ty) - 1;
}

double fractal(double east, double north, const TerrainDescription& description, std::uint32_t seed) {
  double sum = 0, amplitude = 0.55;
  double x = east / description.feature, y = north / description.feature;
  for (std::uint32_t octave = 0;
       octave < 12 && description.feature / std::exp2(octave) > 2 * description.spacing; ++octave) {
    sum += amplitude * valueNoise(x, y, seed + octave);
    const double turned = 1.6 * x - 1.2 * y + 5.7;
    y = 1.2 * x + 1.6 * y - 3.1;
    x = turned;
    amplitude *= 0.42;
  }
  return std::clamp(sum, -1.0, 1.0) * description.relief;
}

}  // namespace

Result<Terrain> Terrain::make(const TerrainDescription& description, std::uint32_t seed) {
  cv::Mat map;
  if (description.kind == TerrainDescription::Kind::Map) {
    map = cv::imread(description.map.string(), cv::IMREAD_UNCHANGED);
    if (map.empty() || map.channels() != 1) {
      return fail(ErrorCode::BadSettings,
                  fmt::format("terrain.map: {} is not a readable one-band image", description.map.string()));
    }
    map.convertTo(map, CV_64F);
  }
  Terrain terrain;
  terrain.spacing_ = description.spacing;
  const auto cells = [&](double length) {
    return std::max(1, static_cast<int>(std::ceil(length / description.spacing)));
  };
  terrain.columns_ = cells(description.extent.x()) + 1;
  terrain.rows_ = cells(description.extent.y()) + 1;
  terrain.origin_ = -0.5 * description.spacing * Eigen::Vector2d(terrain.columns_ - 1, terrain.rows_ - 1);
  const std::uint32_t own_seed = seedOf(seed, "terrain");
  terrain.heights_.reserve(static_cast<std::size_t>(terrain.columns_) *
                           static_cast<std::size_t>(terrain.rows_));
  for (int y = 0; y < terrain.rows_; ++y) {
    for (int x = 0; x < terrain.columns_; ++x) {
      const Eigen::Vector2d at = terrain.origin_ + description.spacing * Eigen::Vector2d(x, y);
      double height = 0;
      if (description.kind == TerrainDescription::Kind::Ramp ||
          description.kind == TerrainDescription::Kind::Fractal) {
        height = description.slope.dot(at);
      }
      if (description.kind == TerrainDescription::Kind::Fractal)
        height += fractal(at.x(), at.y(), description, own_seed);
      if (!map.empty()) {  // bilinear, pixel centres, row 0 in the north
        const double column =
            std::clamp((x + 0.0) / (terrain.columns_ - 1) * map.cols - 0.5, 0.0, map.cols - 1.0);
        const double row =
            std::clamp((1 - (y + 0.0) / (terrain.rows_ - 1)) * map.rows - 0.5, 0.0, map.rows - 1.0);
        const int c = std::min(static_cast<int>(column), std::max(0, map.cols - 2)),
                  r = std::min(static_cast<int>(row), std::max(0, map.rows - 2));
        const int c1 = std::min(c + 1, map.cols - 1), r1 = std::min(r + 1, map.rows - 1);
        height = description.map_offset +
                 description.map_scale *
                     std::lerp(std::lerp(map.at<double>(r, c), map.at<double>(r, c1), column - c),
                               std::lerp(map.at<double>(r1, c), map.at<double>(r1, c1), column - c), row - r);
      }
      terrain.heights_.push_back(static_cast<float>(height));
    }
  }
  return terrain;
}

Eigen::Vector2d Terrain::east_north() const {
  return origin_ + spacing_ * Eigen::Vector2d(columns_ - 1, rows_ - 1);
}

double Terrain::heightAt(double east, double north) const {
  const double u = std::clamp((east - origin_.x()) / spacing_, 0.0, columns_ - 1.0);
  const double v = std::clamp((north - origin_.y()) / spacing_, 0.0, rows_ - 1.0);
  const int x = std::min(static_cast<int>(u), columns_ - 2), y = std::min(static_cast<int>(v), rows_ - 2);
  const double s = u - x, t = v - y;
  // The cell's diagonal runs from south-west to north-east.
  const double h00 = corner(x, y), h11 = corner(x + 1, y + 1);
  return s >= t ? h00 + s * (corner(x + 1, y) - h00) + t * (h11 - corner(x + 1, y))
                : h00 + t * (corner(x, y + 1) - h00) + s * (h11 - corner(x, y + 1));
}

double Terrain::steepnessAt(double east, double north) const {
  const double d = spacing_;
  return std::hypot(heightAt(east + d, north) - heightAt(east - d, north),
                    heightAt(east, north + d) - heightAt(east, north - d)) /
         (2 * d);
}

Mesh Terrain::mesh(double chunk_cell) const {
  Mesh mesh;
  mesh.vertices.reserve(heights_.size());
  for (int y = 0; y < rows_; ++y) {
    for (int x = 0; x < columns_; ++x) {
      const int x0 = std::max(x - 1, 0), x1 = std::min(x + 1, columns_ - 1), y0 = std::max(y - 1, 0),
                y1 = std::min(y + 1, rows_ - 1);
      const Eigen::Vector3f normal =
          Eigen::Vector3d((corner(x0, y) - corner(x1, y)) / ((x1 - x0) * spacing_),
                          (corner(x, y0) - corner(x, y1)) / ((y1 - y0) * spacing_), 1)
              .normalized()
              .cast<float>();
      Vertex vertex;
      vertex.x = static_cast<float>(origin_.x() + spacing_ * x);
      vertex.y = static_cast<float>(origin_.y() + spacing_ * y);
      vertex.z = static_cast<float>(corner(x, y));
      vertex.nx = normal.x();
      vertex.ny = normal.y();
      vertex.nz = normal.z();
      mesh.vertices.push_back(vertex);
    }
  }
  for (int y = 0; y + 1 < rows_; ++y) {
    for (int x = 0; x + 1 < columns_; ++x) {
      const auto sw = static_cast<std::uint32_t>(y * columns_ + x), se = sw + 1;
      const auto nw = sw + static_cast<std::uint32_t>(columns_), ne = nw + 1;
      mesh.indices.insert(mesh.indices.end(), {sw, se, ne, sw, ne, nw});
    }
  }
  chunkMesh(mesh, chunk_cell);
  return mesh;
}

}  // namespace overfly::scene
