#include "render/preview/previewer.h"

#include <algorithm>

namespace overfly::preview {

Previewer::Previewer(gl::Context& context, RamCache& ram, const Options& options)
    : context_(context), ram_(ram), options_(options), caster_(context) {}

Previewer::~Previewer() = default;

void Previewer::reset() {
  cache_.reset();
  textures_.reset();
  caster_ = RayCaster(context_);
  projectors_.reset();
  focus_.reset();
}

Result<void> Previewer::prepare(const Look& look) {
  const auto extent = ram_.source().extent();
  if (!extent) return tl::unexpected(extent.error());
  const auto domain = Domain::create(*extent);
  if (!domain) return tl::unexpected(domain.error());
  if (cache_ != nullptr && cache_->domain() == *domain && no_data_ == look.no_data) return {};
  cache_.reset();
  textures_.reset();
  focus_.reset();
  no_data_ = look.no_data;
  ClipCache::Options options;
  options.order = options_.order;
  options.no_data = look.no_data;
  options.clip.active = options_.active;
  options.clip.max_slots =
      std::clamp(static_cast<int>(options_.gpu_bytes / MapTextures::bytesPerTile(domain->tileSize())), 16,
                 context_.info().limits.texture_layers * 4);
  // With little memory rather smaller areas than fewer levels.
  while (options.clip.active > 3 &&
         options.clip.active * options.clip.active * 3 + 9 * domain->levels() > options.clip.max_slots)
    --options.clip.active;
  const ClipLayout layout(*domain, options.clip);
  auto textures = MapTextures::create(context_, domain->tileSize(), layout.slots());
  if (!textures) return tl::unexpected(textures.error());
  textures_ = std::move(*textures);
  cache_ = std::make_unique<ClipCache>(*domain, ram_, *textures_, options);
  return {};
}

Result<ClipCache::Update> Previewer::update(const View& view, const ClipCache::Budget& budget) {
  const auto frame = RayFrame::create(cache_->domain(), view.position, cache_->baseHeight());
  if (!frame) return tl::unexpected(frame.error());
  const double ground = cache_->ready() ? cache_->baseHeight() : view.position.height_m - 100;
  Focus focus = focusOf(view, *frame, cache_->domain(), ground);
  if (focus_ && !focus.centres.empty()) focus.motion = focus.centres[0] - focus_->centres[0];
  focus_ = focus;
  const ClipCache::Update update = cache_->update(focus, budget);
  if (!cache_->ready()) return update;
  // The base height may have been found just now.
  frame_ = RayFrame::create(cache_->domain(), view.position, cache_->baseHeight()).value();
  if (const auto table = textures_->uploadTable(context_, *cache_); !table)
    return tl::unexpected(table.error());
  return update;
}

Result<void> Previewer::updateProjectors(const View& view, const Look& look, int loads) {
  projectors_left_ = 0;
  if (projector_source_ == nullptr) projectors_.reset();
  if (look.projectors <= 0 || projector_source_ == nullptr) {
    caster_.project(nullptr);
    return {};
  }
  if (!projectors_) {
    auto made = ProjectorTextures::create(context_, {});
    if (!made) return tl::unexpected(made.error());
    projectors_ = std::move(*made);
  }
  const Domain& domain = cache_->domain();
  ProjectorQuery query{view, 0, std::min(look.projectors, ProjectorTextures::kMost), look.projector_angle};
  // As far as the ground's lowest plane in the picture's corners, and no farther than the map's other end.
  const double above = std::max(view.position.height_m - cache_->lowest(), 1.0);
  const Eigen::Vector2d middle = (domain.minTexel() + domain.maxTexel()) / 2 - frame_->cell.cast<double>();
  const double end =
      (middle.norm() + (domain.maxTexel() - domain.minTexel()).norm() / 2) * domain.texelSize() + above;
  for (int i = 0; i < 4; ++i) {
    const Eigen::Vector3d d = view.direction((i & 1) * view.width, (i >> 1) * view.height);
    query.far_m = std::max(query.far_m, d.z() < -1e-3 ? std::min(above / -d.z(), end) : end);
  }
  const auto chosen = projector_source_->choose(query);
  if (!chosen) return tl::unexpected(chosen.error());
  projectors_left_ = projectors_->update(*projector_source_, *chosen, loads);
  caster_.project(&*projectors_);
  return {};
}

Result<ClipCache::Update> Previewer::refine(const View& view, const Look& look,
                                            const ClipCache::Budget& budget) {
  if (auto prepared = prepare(look); !prepared) return tl::unexpected(prepared.error());
  const auto updated = update(view, budget);
  if (!updated || !cache_->ready()) return updated;
  if (auto ready = updateProjectors(view, look, 1); !ready) return tl::unexpected(ready.error());
  return updated;
}

Result<Previewer::Frame> Previewer::draw(const View& view, const Look& look, const ClipCache::Budget& budget,
                                         bool hits) {
  const auto updated = refine(view, look, budget);
  if (!updated) return tl::unexpected(updated.error());
  if (!cache_->ready())
    return fail(ErrorCode::Unavailable, "the map's tiles are still being read; ask again");
  auto picture = caster_.draw(view, *frame_, look, *cache_, *textures_, hits);
  if (!picture) return tl::unexpected(picture.error());
  return Frame{std::move(*picture), *updated, 1, shownProjectors(look)};
}

Result<Previewer::Frame> Previewer::drawSettled(const View& view, const Look& look, bool hits) {
  if (auto prepared = prepare(look); !prepared) return tl::unexpected(prepared.error());
  // Each round asks for what the last one's coarser tiles call for; a map that changes meanwhile ends it,
  // too.
  constexpr int kRounds = 8;
  int rounds = 0;
  Result<ClipCache::Update> updated = ClipCache::Update{};
  for (; rounds < kRounds; ++rounds) {
    // Before the map's top is there the ground's height is a guess, and so is what the view calls for.
    const bool guess = !cache_->ready();
    updated = update(view, {});
    if (!updated) return tl::unexpected(updated.error());
    if (rounds > 0 && !guess && updated->settled()) break;
    ram_.loadDue();
  }
  if (!cache_->ready()) return fail(ErrorCode::NotFound, "the map has no elevation to draw yet");
  if (auto ready = updateProjectors(view, look, ProjectorTextures::kMost); !ready)
    return tl::unexpected(ready.error());
  auto picture = caster_.draw(view, *frame_, look, *cache_, *textures_, hits);
  if (!picture) return tl::unexpected(picture.error());
  return Frame{std::move(*picture), *updated, rounds, shownProjectors(look)};
}

int Previewer::shownProjectors(const Look& look) const {
  return projectors_ && look.projectors > 0 ? projectors_->count() : 0;
}

geo::Geodetic Previewer::placeOf(const RayHit& hit) const {
  geo::Geodetic place =
      cache_->domain().lattice().geodeticFromPlane(cache_->domain().planeFromTexel(hit.texel));
  place.height_m = hit.height_m;
  return place;
}

}  // namespace overfly::preview
