#include "render/scene/detail/settlement.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "render/scene/random.h"

namespace overfly::scene {

Eigen::Vector2d Footprint2::at(double along, double across) const {
  return centre + Eigen::Rotation2Dd(turn) * Eigen::Vector2d(along, across);
}

bool Footprint2::touches(const Footprint2& other) const {
  for (const double angle :
       {turn, turn + std::numbers::pi / 2, other.turn, other.turn + std::numbers::pi / 2}) {
    const Eigen::Vector2d axis(std::cos(angle), std::sin(angle));
    const auto reach = [&](const Footprint2& f) {
      const Eigen::Vector2d local = Eigen::Rotation2Dd(-f.turn) * axis;
      return std::abs(local.x()) * f.half.x() + std::abs(local.y()) * f.half.y();
    };
    if (std::abs(axis.dot(other.centre - centre)) >= reach(*this) + reach(other)) return false;
  }
  return true;
}

double Footprint2::distance(const Eigen::Vector2d& p) const {
  return ((Eigen::Rotation2Dd(-turn) * (p - centre)).cwiseAbs() - half).cwiseMax(0).norm();
}

std::pair<double, double> Site::groundUnder(const Footprint2& footprint) const {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (int i = 0; i <= 8; ++i) {
    for (int k = 0; k <= 8; ++k) {
      const Eigen::Vector2d p =
          footprint.at((i / 4.0 - 1) * footprint.half.x(), (k / 4.0 - 1) * footprint.half.y());
      const double ground = terrain.heightAt(p.x(), p.y());
      low = std::min(low, ground);
      high = std::max(high, ground);
    }
  }
  return {low, high};
}

void buildCar(SolidBuilder& solids, const Eigen::Vector2d& centre, double turn, double ground,
              std::uint32_t number) {
  solids.beginObject(number);
  const Footprint2 frame{centre, {0, 0}, turn};
  solids.box(centre, {4.3, 1.75}, turn, ground + 0.2, ground + 0.85, Material::Car, Material::Car);
  // The cabin's sides are glass: v below zero (shaders/material.glsl), its roof is paint.
  const double z0 = ground + 0.85, z1 = ground + 1.42;
  const auto ring = [&](double half_length, double half_width, double shift, double z) {
    std::array<Eigen::Vector3d, 4> corners;
    const double signs[4][2] = {{-1, -1}, {1, -1}, {1, 1}, {-1, 1}};
    for (std::size_t i = 0; i < 4; ++i) {
      const Eigen::Vector2d p = frame.at(shift + signs[i][0] * half_length, signs[i][1] * half_width);
      corners[i] = {p.x(), p.y(), z};
    }
    return corners;
  };
  const auto low = ring(1.25, 0.82, -0.2, z0), high = ring(0.75, 0.68, -0.3, z1);
  for (std::size_t i = 0; i < 4; ++i) {
    const std::size_t k = (i + 1) % 4;
    const Eigen::Vector3d u = (low[k] - low[i]).normalized();
    solids.face({low[i], low[k], high[k], high[i]}, Material::Car, high[i] + Eigen::Vector3d::UnitZ(), u,
                Eigen::Vector3d::UnitZ());
  }
  const Eigen::Vector3d u = (high[1] - high[0]).normalized();
  solids.face({high[0], high[1], high[2], high[3]}, Material::Car, high[0] - u, u,
              Eigen::Vector3d::UnitZ().cross(u));
}

namespace {

// One plot: `street` is the middle of its street side, `turn` points along the street, the garden lies to the
// left of that direction.
class PlotBuilder {
 public:
  PlotBuilder(Site& site, const Footprint2& plot, std::uint32_t number)
      : site_(site), plot_(plot), seed_(hashOf(seedOf(site.scene.seed, "plots"), number)), number_(number) {}

  void build() {
    const SettlementDescription& settlement = site_.scene.settlement;
    const double width = 2 * plot_.half.x();
    // A garden is a lawn, whatever field the plot was cut from.
    site_.cover.paintArea(
        {plot_.at(-plot_.half.x(), -plot_.half.y()), plot_.at(plot_.half.x(), -plot_.half.y()),
         plot_.at(plot_.half.x(), plot_.half.y()), plot_.at(-plot_.half.x(), plot_.half.y())},
        Base::Lawn);
    const double front = -plot_.half.y() + settlement.setback + 1.5 * draw(1);
    const Eigen::Vector2d size(std::min(width - 5.5, 10.5 + 3.5 * draw(2)), 7.6 + 2.4 * draw(3));
    const double shift = (draw(4) - 0.5) * 1.6;
    house(shift, front + 0.5 * size.y(), size);
    garage(shift, front, size, width);
    garden(shift, front, size, width);
  }

 private:
  [[nodiscard]] double draw(std::uint32_t what) const { return uniform(seed_, what); }

  void take(const Footprint2& footprint) { site_.taken.push_back(footprint); }

  void house(double along, double across, const Eigen::Vector2d& size) {
    const SettlementDescription& settlement = site_.scene.settlement;
    const bool turned = draw(5) < 0.3 && size.x() < 1.5 * size.y();  // ridge across the street
    Footprint2 body{plot_.at(along, across), 0.5 * size, plot_.turn};
    take(body);
    const auto [low, high] = site_.groundUnder(body);
    const double storeys = std::floor(settlement.storeys.x() +
                                      draw(6) * (settlement.storeys.y() - settlement.storeys.x() + 0.999));
    const double eaves = high + 2.9 * storeys + 0.3;
    const double pitch = 0.62 + 0.28 * draw(7);
    const Material roof = draw(8) < 0.74 ? Material::ClayTiles : Material::Slate;
    const Eigen::Vector2d ridge_size = turned ? Eigen::Vector2d(size.y(), size.x()) : size;
    const double ridge_turn = plot_.turn + (turned ? std::numbers::pi / 2 : 0);
    const double ridge = eaves + 0.5 * pitch * ridge_size.y();
    site_.solids.beginObject(3 * number_ + 1);
    site_.solids.gable(body.centre, ridge_size, ridge_turn, low - 0.5, eaves, ridge, 0.45, Material::Plaster,
                       roof);
    if (draw(9) < 0.45) {  // a wing towards the garden, lower, its ridge across
      const Eigen::Vector2d wing(0.42 * size.x(), size.y() * 0.9);
      const double side = draw(10) < 0.5 ? -1 : 1;
      const Footprint2 extension{
          plot_.at(along + side * 0.5 * (size.x() - wing.x()), across + 0.5 * (size.y() + wing.y()) - 1.5),
          0.5 * wing, plot_.turn};
      take(extension);
      const double wing_eaves = eaves - 0.4;
      site_.solids.gable(extension.centre, {wing.y(), wing.x()}, plot_.turn + std::numbers::pi / 2, low - 0.5,
                         wing_eaves, wing_eaves + 0.5 * pitch * wing.x(), 0.35, Material::Plaster, roof);
    }
    const Footprint2 frame{body.centre, {0, 0}, ridge_turn};
    const double chimney = (draw(11) - 0.5) * 0.6 * ridge_size.x();
    site_.solids.beginObject(3 * number_ + 2);
    site_.solids.box(frame.at(chimney, 0.5), {0.7, 0.7}, ridge_turn, eaves, ridge + 0.8, Material::Concrete,
                     Material::FlatRoof);
    if (draw(12) < 0.55) {  // dormers on the slope
      const int count = ridge_size.x() > 11 ? 2 : 1;
      for (int i = 0; i < count; ++i) {
        const double x = count == 1 ? 0.15 * ridge_size.x() : (i - 0.5) * 0.45 * ridge_size.x();
        const double y = -0.27 * ridge_size.y();
        site_.solids.box(frame.at(x, y), {1.9, 0.26 * ridge_size.y() + 1}, ridge_turn, eaves + 0.2,
                         eaves + pitch * (0.5 * ridge_size.y() + y) + 1.1, Material::Plaster,
                         Material::FlatRoof);
      }
    }
  }

  void garage(double along, double front, const Eigen::Vector2d& size, double width) {
    const double side = draw(20) < 0.5 ? -1 : 1;
    const double free = 0.5 * width - (side * along + 0.5 * size.x());
    if (free < 3.4) {
      driveway(side * (0.5 * width - 1.9), front + 1.5);
      return;
    }
    const double x = along + side * (0.5 * size.x() + 1.75);
    const Footprint2 body{plot_.at(x, front + 4.2), {1.6, 3.0}, plot_.turn};
    take(body);
    const auto [low, high] = site_.groundUnder(body);
    site_.solids.beginObject(3 * number_ + 3);
    site_.solids.box(body.centre, 2 * body.half, body.turn, low - 0.3, high + 2.6, Material::Plaster,
                     Material::FlatRoof);
    driveway(x, front + 1.2);
  }

  void driveway(double x, double until) {
    const double from = -plot_.half.y() - 1;
    site_.cover.paintPaving(plot_.at(x, 0.5 * (from + until)), {3.0, until - from}, plot_.turn);
    if (draw(21) > 0.45 || until - from < 6.5) return;
    const Footprint2 car{plot_.at(x, until - 3.0), {2.2, 0.9}, plot_.turn + std::numbers::pi / 2};
    take(car);
    buildCar(site_.solids, car.centre, car.turn, site_.terrain.heightAt(car.centre.x(), car.centre.y()),
             number_ * 7 + 5);
  }

  void garden(double along, double front, const Eigen::Vector2d& size, double width) {
    const SettlementDescription& settlement = site_.scene.settlement;
    const double back = front + size.y();
    site_.cover.paintPaving(plot_.at(along, 0.5 * (front - plot_.half.y() - 1)),
                            {1.3, front + plot_.half.y() + 1}, plot_.turn);
    site_.cover.paintPaving(plot_.at(along - 0.12 * size.x(), back + 2.0), {0.6 * size.x(), 4.4}, plot_.turn);
    if (draw(30) < 0.65) {  // vegetable beds at the far end
      const int beds = 2 + static_cast<int>(3 * draw(31));
      for (int i = 0; i < beds; ++i) {
        site_.cover.paintBed(plot_.at(-0.5 * width + 2.6 + 2.0 * i, plot_.half.y() - 3.6), {1.3, 4.2},
                             plot_.turn);
      }
    }
    if (draw(32) < settlement.sheds) {
      const Footprint2 shed{
          plot_.at(0.5 * width - 3.0, plot_.half.y() - 3.2 - 2 * draw(33)), {1.7, 1.3}, plot_.turn};
      take(shed);
      const auto [low, high] = site_.groundUnder(shed);
      site_.solids.beginObject(number_ * 5 + 4);
      site_.solids.gable(shed.centre, 2 * shed.half, shed.turn, low - 0.2, high + 1.9, high + 2.6, 0.2,
                         Material::Timber, draw(34) < 0.5 ? Material::Timber : Material::FlatRoof);
    }
    if (draw(35) >= settlement.hedges) return;
    const double y0 = -plot_.half.y() + 0.8, y1 = plot_.half.y() - 0.5;
    hedge({-0.5 * width + 0.45, y0}, {-0.5 * width + 0.45, y1});
    hedge({-0.5 * width + 0.45, y1}, {0.5 * width - 0.45, y1});
    if (draw(36) < 0.5) hedge({0.5 * width - 0.45, y0}, {0.5 * width - 0.45, y1});
  }

  // In pieces, so that it follows the ground and its top is not a ruler's edge.
  void hedge(const Eigen::Vector2d& from, const Eigen::Vector2d& to) {
    const double length = (to - from).norm();
    const int pieces = std::max(1, static_cast<int>(length / 1.7));
    const double turn = plot_.turn + std::atan2(to.y() - from.y(), to.x() - from.x());
    for (int i = 0; i < pieces; ++i) {
      const std::uint32_t which =
          hashOf(seed_, 40, static_cast<std::uint32_t>(1000 * length) + static_cast<std::uint32_t>(i));
      const Eigen::Vector2d middle = from + (i + 0.5) / pieces * (to - from);
      const Eigen::Vector2d p = plot_.at(middle.x(), middle.y());
      const double ground = site_.terrain.heightAt(p.x(), p.y());
      site_.solids.beginObject(which & 0xffff);
      site_.solids.box(p, {length / pieces + 0.02, 0.75 + 0.35 * uniform(which, 1)},
                       turn + 0.05 * (uniform(which, 3) - 0.5), ground - 0.4,
                       ground + 1.2 + 0.5 * uniform(which, 2), Material::Hedge, Material::Hedge);
    }
  }

  Site& site_;
  Footprint2 plot_;
  std::uint32_t seed_;
  std::uint32_t number_;
};

void parkCars(Site& site, const StreetDescription& street, std::uint32_t seed) {
  std::uint32_t place = 0;
  for (std::size_t i = 0; i + 1 < street.points.size(); ++i) {
    const Eigen::Vector2d a = street.points[i], along = (street.points[i + 1] - a).normalized();
    const double length = (street.points[i + 1] - a).norm(), turn = std::atan2(along.y(), along.x());
    for (double s = 7; s < length - 7; s += 6.2) {
      for (const double side : {-1.0, 1.0}) {
        ++place;
        if (100 * uniform(seed, place) >= street.parked_cars_percent) continue;
        const Eigen::Vector2d p =
            a + s * along + side * (0.5 * street.width - 1.15) * Eigen::Vector2d(-along.y(), along.x());
        bool crossing = false;
        for (const StreetDescription& other : site.scene.streets) {
          crossing =
              crossing || (&other != &street && distanceToLine(p, other.points) < 0.5 * other.width + 4);
        }
        if (!crossing)
          buildCar(site.solids, p, turn + (side > 0 ? std::numbers::pi : 0),
                   site.terrain.heightAt(p.x(), p.y()), seed + place);
      }
    }
  }
}

}  // namespace

void buildSettlement(Site& site) {
  const SceneDescription& scene = site.scene;
  std::vector<Footprint2> plots;
  const std::vector<Footprint2> built = site.taken;  // what the scene places itself
  std::uint32_t number = 0, street_number = 0;
  for (const StreetDescription& street : scene.streets) {
    ++street_number;
    if (street.parked_cars_percent > 0)
      parkCars(site, street, hashOf(seedOf(scene.seed, "parked"), street_number));
    if (!street.houses) continue;
    for (std::size_t i = 0; i + 1 < street.points.size(); ++i) {
      const Eigen::Vector2d a = street.points[i], along = (street.points[i + 1] - a).normalized();
      const double length = (street.points[i + 1] - a).norm();
      for (const double side : {1.0, -1.0}) {
        const Eigen::Vector2d outward = side * Eigen::Vector2d(-along.y(), along.x());
        for (double s = 0.5 * street.plot; s + 0.5 * street.plot <= length + 0.1; s += street.plot) {
          const double depth = scene.settlement.depth;
          Footprint2 plot;
          plot.half = {0.5 * street.plot - 0.2, 0.5 * depth};
          plot.turn = std::atan2(along.y(), along.x()) + (side > 0 ? 0 : std::numbers::pi);
          plot.centre = a + s * along + (0.5 * street.width + scene.pavement + 0.5 * depth) * outward;
          ++number;
          const auto touched = [&](const Footprint2& other) { return plot.touches(other); };
          bool is_free = std::none_of(plots.begin(), plots.end(), touched) &&
                         std::none_of(built.begin(), built.end(), touched) &&
                         (plot.centre - site.terrain.west_south()).minCoeff() > 20 &&
                         (site.terrain.east_north() - plot.centre).minCoeff() > 20;
          for (const StreetDescription& other : scene.streets) {
            for (std::size_t k = 0; is_free && k + 1 < other.points.size(); ++k) {
              const Eigen::Vector2d d = other.points[k + 1] - other.points[k];
              const Footprint2 lane{other.points[k] + 0.5 * d,
                                    {0.5 * d.norm(), 0.5 * other.width + 0.5 * scene.pavement},
                                    std::atan2(d.y(), d.x())};
              is_free = !plot.touches(lane);
            }
          }
          if (!is_free) continue;
          plots.push_back(plot);
          PlotBuilder(site, plot, number).build();
        }
      }
    }
  }
}

}  // namespace overfly::scene
