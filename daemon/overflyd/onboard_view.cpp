#include "daemon/overflyd/onboard_view.h"

#include <chrono>
#include <thread>

#include "daemon/overflyd/onboard_photographs.h"
#include "render/preview/previewer.h"
#include "render/preview/projector_textures.h"
#include "tiling/preview/store_tile_source.h"

namespace overfly::daemon {
namespace {

// The link knows nothing of the preview.
static_assert(link::PreviewView::kMostPhotos == preview::ProjectorTextures::kMost);

using namespace std::chrono_literals;

constexpr auto kPatience = 3s;
constexpr auto kUploadTime = 10ms;     // on the GPU thread at a time
constexpr auto kPollInterval = 250ms;  // for tiles that have changed

}  // namespace

struct OnboardView::Scene {
  std::filesystem::path map;
  std::unique_ptr<tiling::StoreTileSource> source;
  std::unique_ptr<preview::RamCache> ram;
  std::unique_ptr<OnboardPhotographs> photographs;  // from the first view on that asks for some
  std::unique_ptr<preview::Previewer> previewer;
  std::uint64_t generation = 0;  // of the context that the previewer was made with
};

OnboardView::OnboardView(const config::Preview& settings, gl::GlThread& gl) : gl_(gl), settings_(settings) {}

OnboardView::~OnboardView() {
  const std::lock_guard lock(mutex_);
  close();
}

link::PreviewLimits OnboardView::limits() const {
  const std::lock_guard lock(settings_mutex_);
  return {settings_.max_width_px, settings_.max_height_px, settings_.max_rate_fps, settings_.jpeg_quality};
}

void OnboardView::reload(const config::Preview& settings) {
  const std::lock_guard lock(settings_mutex_);
  settings_ = settings;
}

void OnboardView::close() {
  if (!scene_) return;
  (void)gl_
      .submit(gl::Priority::Preview, "preview.close",
              [this](gl::Context&) -> Result<void> {
                scene_->previewer.reset();
                return {};
              })
      .get();
  scene_.reset();
}

Result<void> OnboardView::open(const std::filesystem::path& map) {
  if (scene_ && scene_->map == map) return {};
  close();
  auto source = tiling::StoreTileSource::open(map);
  if (!source) {
    const ErrorCode code = source.error().code;
    if (code == ErrorCode::NotFound || code == ErrorCode::BadInput)  // the file is still to be made
      return fail(ErrorCode::Unavailable, "the map has no tiles yet");
    return tl::unexpected(source.error());
  }
  auto scene = std::make_unique<Scene>();
  scene->map = map;
  scene->source = std::move(*source);
  std::size_t budget_bytes = 0;
  {
    const std::lock_guard lock(settings_mutex_);
    budget_bytes = static_cast<std::size_t>(settings_.cache_mb) << 20;
  }
  scene->ram = std::make_unique<preview::RamCache>(*scene->source,
                                                   preview::RamCache::Options{.budget_bytes = budget_bytes});
  scene->ram->startLoading(kPollInterval);
  scene_ = std::move(scene);
  return {};
}

// Once the ground's height is known.
Result<void> OnboardView::openPhotographs() {
  auto photographs = OnboardPhotographs::open(scene_->map, scene_->previewer->cache()->baseHeight());
  if (!photographs) return tl::unexpected(photographs.error());
  scene_->photographs = std::move(*photographs);
  scene_->previewer->setProjectors(scene_->photographs.get());
  return {};
}

Result<link::PreviewPicture> OnboardView::draw(const std::filesystem::path& map,
                                               const link::PreviewView& asked) {
  std::size_t gpu_bytes = 0;
  {
    const std::lock_guard lock(settings_mutex_);
    if (!settings_.enabled) return fail(ErrorCode::Unsupported, "previews are turned off (preview.enabled)");
    gpu_bytes = static_cast<std::size_t>(settings_.cache_mb) << 20;
  }
  const std::lock_guard lock(mutex_);
  if (auto opened = open(map); !opened) return tl::unexpected(opened.error());
  preview::View view;
  view.position = asked.position;
  view.heading = asked.heading;
  view.pitch = asked.pitch;
  view.fov = asked.fov;
  view.width = asked.width;
  view.height = asked.height;
  preview::Look look;
  look.projectors = asked.photos;
  const preview::ClipCache::Budget budget{.time = kUploadTime, .aside = true};
  // On the GL thread: a previewer of this context.
  const auto ready = [&](gl::Context& context) {
    if (scene_->previewer && scene_->generation == gl_.generation()) return;
    scene_->previewer.reset();
    scene_->previewer = std::make_unique<preview::Previewer>(
        context, *scene_->ram, preview::Previewer::Options{.gpu_bytes = gpu_bytes});
    scene_->previewer->setProjectors(scene_->photographs.get());
    scene_->generation = gl_.generation();
  };
  if (scene_->photographs) scene_->photographs->refresh();
  // What the view calls for, a few tiles and a photograph a slice; the RAM cache's own thread reads the tiles
  // meanwhile, this one the photographs.
  const auto until = std::chrono::steady_clock::now() + kPatience;
  for (int rounds = 0; std::chrono::steady_clock::now() < until; ++rounds) {
    const auto refined = gl_.submit(gl::Priority::Preview, "preview.refine",
                                    [&](gl::Context& context) -> Result<preview::ClipCache::Update> {
                                      ready(context);
                                      return scene_->previewer->refine(view, look, budget);
                                    })
                             .get();
    if (!refined) return tl::unexpected(refined.error());
    const preview::Previewer& previewer = *scene_->previewer;  // the GPU thread rests
    const bool ready_to_draw = previewer.cache()->ready();
    if (ready_to_draw && asked.photos > 0 && !scene_->photographs) {
      if (auto opened = openPhotographs(); !opened) return tl::unexpected(opened.error());
      continue;
    }
    if (rounds > 0 && ready_to_draw && refined->settled() && previewer.projectorsLeft() == 0) break;
    const bool read = asked.photos > 0 && scene_->photographs && scene_->photographs->readNext();
    if (!read && refined->uploads == 0) std::this_thread::sleep_for(10ms);
  }
  auto frame = gl_.submit(gl::Priority::Preview, "preview.draw",
                          [&](gl::Context& context) -> Result<preview::Previewer::Frame> {
                            ready(context);
                            return scene_->previewer->draw(view, look, budget);
                          })
                   .get();
  if (!frame) return tl::unexpected(frame.error());
  return link::PreviewPicture{frame->picture.width, frame->picture.height, std::move(frame->picture.rgba)};
}

}  // namespace overfly::daemon
