#include "render/preview/surface.h"

#include <algorithm>

namespace overfly::preview {
namespace {

double linear(const Neighbourhood& h, double u, double v) {
  const std::size_t column = u < 0.5 ? 0 : 1, row = v < 0.5 ? 0 : 1;  // north-west of the four centres around
  const double a = u + 0.5 - static_cast<double>(column), b = v + 0.5 - static_cast<double>(row);
  const double* p = &h[3 * row + column];
  return (1 - b) * ((1 - a) * p[0] + a * p[1]) + b * ((1 - a) * p[3] + a * p[4]);
}

// The thesis counts v northwards, here it grows southwards: the formulas are symmetric in that.
double bicubic(const Neighbourhood& h, double u, double v) {
  const auto at = [&h](std::size_t row, std::size_t column) { return h[3 * row + column]; };
  double value[2][2], along_u[2][2], along_v[2][2], mixed[2][2];  // at the corners [u end][v end]
  for (std::size_t i = 0; i < 2; ++i) {
    for (std::size_t j = 0; j < 2; ++j) {
      const double nw = at(j, i), ne = at(j, i + 1), sw = at(j + 1, i), se = at(j + 1, i + 1);
      value[i][j] = std::min({nw, ne, sw, se});  // (4.9)
      along_u[i][j] = (ne + se - nw - sw) / 2;   // (4.12)
      along_v[i][j] = (sw + se - nw - ne) / 2;   // (4.13)
      mixed[i][j] = se - sw - ne + nw;           // (4.14)
    }
  }
  // (4.10), written out: cubic Hermite in v, then in u.
  const auto hermite = [](double p0, double p1, double m0, double m1, double s) {
    const double s2 = s * s, s3 = s2 * s;
    return (2 * s3 - 3 * s2 + 1) * p0 + (3 * s2 - 2 * s3) * p1 + (s3 - 2 * s2 + s) * m0 + (s3 - s2) * m1;
  };
  double p[2], m[2];
  for (int i = 0; i < 2; ++i) {
    p[i] = hermite(value[i][0], value[i][1], along_v[i][0], along_v[i][1], v);
    m[i] = hermite(along_u[i][0], along_u[i][1], mixed[i][0], mixed[i][1], v);
  }
  return hermite(p[0], p[1], m[0], m[1], u);
}

}  // namespace

double surfaceHeight(Surface surface, const Neighbourhood& h, double u, double v) {
  switch (surface) {
    case Surface::Blocks:
      return h[4];
    case Surface::Linear:
      return linear(h, u, v);
    case Surface::Bicubic:
      return bicubic(h, u, v);
  }
  return h[4];
}

}  // namespace overfly::preview
