#include "render/amplify/selector.h"

#include <algorithm>
#include <limits>
#include <vector>

#include "amplify_shaders.h"
#include "render/gl/commands.h"

namespace overfly::amplify {
namespace {

namespace text = overfly::shaders::amplify;

template <typename T, typename Made>
Result<void> assign(T& target, Made&& made) {
  if (!made) return tl::unexpected<Error>(made.error());
  target = std::move(*made);
  return {};
}

}  // namespace

Result<PlantSelector> PlantSelector::create(gl::Context& context, const Population& population,
                                            const HeightGrid& ground, int capacity) {
  PlantSelector s;
  s.context_ = &context;
  s.range_ = population.tiles();
  s.capacity_ = capacity;
  s.seed_ = population.seed;
  s.rules_ = population.rules;
  s.cover_corner_ = Eigen::Vector2d(population.cover.west(), population.cover.south()).cast<float>();
  s.grid_corner_ = ground.corner.cast<float>();
  s.spacing_ = static_cast<float>(ground.spacing);
  const auto [low, high] = std::minmax_element(ground.heights.begin(), ground.heights.end());
  s.ground_range_ = {*low, *high};

  const auto program = [&](gl::Program& target, gl::ShaderFile file) {
    const std::array<gl::ShaderFile, 2> files{{{"seeds.glsl", text::seeds_glsl}, file}};
    return assign(target, gl::Program::compute(context, files));
  };
  if (auto r = program(s.load_map_, {"tile_load_map.comp", text::tile_load_map_comp}); !r)
    return tl::unexpected<Error>(r.error());
  if (auto r = program(s.select_, {"seed_select.comp", text::seed_select_comp}); !r)
    return tl::unexpected<Error>(r.error());
  if (auto r = program(s.scan_, {"scan.comp", text::scan_comp}); !r) return tl::unexpected<Error>(r.error());
  if (auto r = program(s.scatter_, {"scatter.comp", text::scatter_comp}); !r)
    return tl::unexpected<Error>(r.error());

  std::vector<std::uint32_t> seeds;
  for (const PatternSeed& seed : population.patterns.seeds())
    seeds.push_back(seed.x | static_cast<std::uint32_t>(seed.y) << 16);
  const std::size_t tiles = s.tiles();
  if (auto r = assign(s.patterns_,
                      gl::Buffer::from(context, std::span(std::as_const(seeds)), gl::BufferUse::Static));
      !r)
    return tl::unexpected<Error>(r.error());
  const auto buffer = [&](gl::Buffer& target, std::size_t bytes) {
    return assign(target, gl::Buffer::create(context, bytes));
  };
  if (auto r = buffer(s.tile_map_, 4 * tiles); !r) return tl::unexpected<Error>(r.error());
  if (auto r = buffer(s.slots_, 4 * tiles * SeedPatterns::kSeeds); !r)
    return tl::unexpected<Error>(r.error());
  if (auto r = buffer(s.counts_, 4 * tiles * kPlantBins); !r) return tl::unexpected<Error>(r.error());
  if (auto r = buffer(s.totals_, 4 * kPlantBins); !r) return tl::unexpected<Error>(r.error());
  if (auto r = buffer(s.instances_, sizeof(Plant) * kPlantBins * static_cast<std::size_t>(capacity)); !r)
    return tl::unexpected<Error>(r.error());

  gl::TextureSpec spec;
  spec.sampling = {gl::Filter::Nearest, gl::Filter::Nearest};
  spec.format = gl::Format::R8UI;
  spec.width = population.cover.width(1);
  spec.height = population.cover.height(1);
  if (auto r = assign(s.cover_, gl::Texture::create(context, spec)); !r)
    return tl::unexpected<Error>(r.error());
  s.cover_.upload(std::span(population.cover.texels(1)));
  spec.format = gl::Format::R32F;
  spec.width = ground.columns;
  spec.height = ground.rows;
  if (auto r = assign(s.heights_, gl::Texture::create(context, spec)); !r)
    return tl::unexpected<Error>(r.error());
  s.heights_.upload(ground.heights);
  return s;
}

void PlantSelector::setInputs(gl::Program& program, const PlantView& view) {
  program.setTexture("cover", 0, cover_);
  program.setTexture("heights", 1, heights_);
  program.set("cover_corner", cover_corner_);
  program.set("grid_corner", grid_corner_);
  program.set("grid_spacing", spacing_);
  program.set("population_seed", seed_);
  std::array<Eigen::Vector4f, 4> sizes;
  std::array<Eigen::Vector2f, 4> limits;
  for (std::size_t i = 0; i < 4; ++i) {
    const SpeciesRule& rule = rules_[i];
    sizes[i] = {rule.least_height_m, rule.greatest_height_m, rule.radius_per_height, rule.steepest};
    limits[i] = {static_cast<float>(rule.seeds_per_tile), rule.highest_m};
  }
  program.set("rule_sizes", std::span<const Eigen::Vector4f>(sizes));
  program.set("rule_limits", std::span<const Eigen::Vector2f>(limits));
  program.set("tiles_from", Eigen::Vector2i(range_.x0, range_.y0));
  program.set("tiles_size", Eigen::Vector2i(range_.x1 - range_.x0, range_.y1 - range_.y0));
  std::array<Eigen::Vector4f, 6> planes;
  for (std::size_t i = 0; i < 6; ++i) planes[i] = view.planes[i].cast<float>();
  program.set("planes", std::span<const Eigen::Vector4f>(planes));
  program.set("eye", Eigen::Vector3f(view.eye.cast<float>()));
  program.set("rings", Eigen::Vector3f(view.rings.cast<float>()));
}

void PlantSelector::finishPass(double& milliseconds) {
  if (!measure_) return;
  context_->finish();
  const auto now = std::chrono::steady_clock::now();
  milliseconds = std::chrono::duration<double, std::milli>(now - pass_start_).count();
  pass_start_ = now;
}

Result<std::array<int, kPlantBins>> PlantSelector::select(const PlantView& view) {
  cost_ = {};
  pass_start_ = std::chrono::steady_clock::now();
  const int tiles = static_cast<int>(this->tiles());
  patterns_.bindStorage(0);
  tile_map_.bindStorage(1);
  slots_.bindStorage(2);
  counts_.bindStorage(3);
  totals_.bindStorage(4);
  instances_.bindStorage(5);
  float tallest = 0;
  for (const SpeciesRule& rule : rules_) tallest = std::max(tallest, 1.25f * rule.greatest_height_m);
  setInputs(load_map_, view);
  load_map_.set("ground_range", ground_range_);
  load_map_.set("tallest", tallest);
  gl::dispatchOver(load_map_, tiles, 1, 1,
                   measure_ ? gl::Barrier::Storage | gl::Barrier::BufferUpdate : gl::Barrier::Storage);
  finishPass(cost_.load_map_ms);
  setInputs(select_, view);
  gl::dispatch(select_, tiles, 1, 1, gl::Barrier::Storage);
  finishPass(cost_.select_ms);
  setInputs(scan_, view);
  gl::dispatch(scan_, 1, 1, 1, gl::Barrier::Storage | gl::Barrier::BufferUpdate);
  setInputs(scatter_, view);
  scatter_.set("capacity", capacity_);
  gl::dispatch(scatter_, tiles, 1, 1, gl::Barrier::Storage | gl::Barrier::Vertex | gl::Barrier::BufferUpdate);
  finishPass(cost_.compact_ms);
  if (measure_) {
    std::vector<std::uint32_t> visible(static_cast<std::size_t>(tiles));
    if (Result<void> read = tile_map_.download(std::span(visible)); !read)
      return tl::unexpected<Error>(read.error());
    cost_.checked_seeds =
        SeedPatterns::kSeeds * static_cast<std::size_t>(std::count(visible.begin(), visible.end(), 1u));
  }
  std::array<std::uint32_t, kPlantBins> totals{};
  if (Result<void> read = totals_.download(std::span<std::uint32_t>(totals)); !read)
    return tl::unexpected<Error>(read.error());
  std::array<int, kPlantBins> counts{};
  for (std::size_t i = 0; i < counts.size(); ++i)
    counts[i] = std::min(static_cast<int>(totals[i]), capacity_);
  return counts;
}

}  // namespace overfly::amplify
