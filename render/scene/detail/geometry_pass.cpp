#include "render/scene/detail/geometry_pass.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "scene_shaders.h"

namespace overfly::scene {
namespace {

namespace text = overfly::shaders::scene;
using gl::ShaderFile;

constexpr ShaderFile kCamera{"camera.glsl", text::camera_glsl};
constexpr ShaderFile kNoise{"noise.glsl", text::noise_glsl};
constexpr ShaderFile kResponse{"response.glsl", text::response_glsl};
constexpr ShaderFile kMaterial{"material.glsl", text::material_glsl};
constexpr ShaderFile kFoliage{"foliage.glsl", text::foliage_glsl};
constexpr ShaderFile kCover{"cover.glsl", text::cover_glsl};
constexpr ShaderFile kLight{"light.glsl", text::light_glsl};
constexpr ShaderFile kSurface{"surface.glsl", text::surface_glsl};
constexpr ShaderFile kShadow{"shadow.glsl", text::shadow_glsl};

template <typename T, typename Make>
Result<void> assign(T& target, Make&& made) {
  if (!made) return tl::unexpected<Error>(made.error());
  target = std::move(*made);
  return {};
}

Result<gl::VertexArray> meshVertices(gl::Context& context, const gl::Buffer& vertices,
                                     const gl::Buffer& indices) {
  constexpr std::size_t kStride = sizeof(Vertex);
  const std::array<gl::Attribute, 4> attributes{
      {{0, &vertices, gl::AttributeType::Float, 3, kStride, offsetof(Vertex, x)},
       {1, &vertices, gl::AttributeType::Float, 3, kStride, offsetof(Vertex, nx)},
       {2, &vertices, gl::AttributeType::Float, 2, kStride, offsetof(Vertex, u)},
       {3, &vertices, gl::AttributeType::U32, 1, kStride, offsetof(Vertex, surface)}}};
  return gl::VertexArray::create(context, attributes, &indices);
}

struct FoliageVertex {
  float corner[2];
  float centre[3], u_axis[3], v_axis[3], normal[3];
  std::uint32_t polygon;
};

}  // namespace

Result<std::unique_ptr<GeometryPass>> GeometryPass::create(gl::Context& context, const World& world,
                                                           const RenderCamera& camera,
                                                           const capture::CameraModel& sensor,
                                                           const std::vector<EffectSettings>& effects) {
  std::unique_ptr<GeometryPass> pass(new GeometryPass(world, camera, sensor));
  if (Result<void> built = pass->build(context, effects); !built) return tl::unexpected<Error>(built.error());
  return pass;
}

Result<void> GeometryPass::build(gl::Context& context, const std::vector<EffectSettings>& effects) {
  effects_ = effects;
  shadows_ = findEffect(effects_, Effect::SunShadows);
  rolling_ = findEffect(effects_, Effect::RollingShutter);
  distortion_ = findEffect(effects_, Effect::LensDistortion);
  specular_ = findEffect(effects_, Effect::Specular);
  wind_ = findEffect(effects_, Effect::WindSway);
  if (shadows_) defines_.push_back({"SUN_SHADOWS"});
  if (rolling_) defines_.push_back({"ROLLING_SHUTTER"});
  if (rolling_ && distortion_) defines_.push_back({"LENS_DISTORTION"});
  if (specular_) defines_.push_back({"SPECULAR"});
  if (wind_) defines_.push_back({"WIND_SWAY"});

  gl::TextureSpec spec;
  spec.width = camera_.width;
  spec.height = camera_.height;
  if (auto r = assign(color_, gl::Texture::create(context, spec)); !r) return r;
  spec.samples = 4;
  if (auto r = assign(samples_color_, gl::Texture::create(context, spec)); !r) return r;
  spec.format = gl::Format::Depth32F;
  if (auto r = assign(samples_depth_, gl::Texture::create(context, spec)); !r) return r;
  const gl::Attachment target{&samples_color_};
  if (auto r = assign(samples_, gl::Framebuffer::create(context, std::span(&target, 1), {&samples_depth_}));
      !r)
    return r;
  if (auto r = assign(resolved_, gl::Framebuffer::create(context, color_)); !r) return r;

  const auto mesh = [&](const Mesh& from, gl::Buffer& vertices, gl::Buffer& indices,
                        gl::VertexArray& array) -> Result<void> {
    if (from.indices.empty()) return {};
    if (auto r = assign(vertices, gl::Buffer::from(context, std::span(from.vertices), gl::BufferUse::Static));
        !r)
      return r;
    if (auto r = assign(indices, gl::Buffer::from(context, std::span(from.indices), gl::BufferUse::Static));
        !r)
      return r;
    return assign(array, meshVertices(context, vertices, indices));
  };
  if (auto r = mesh(world_.ground, ground_vertices_, ground_indices_, ground_); !r) return r;
  if (auto r = mesh(world_.solids, solid_vertices_, solid_indices_, solids_); !r) return r;

  gl::TextureSpec cover;
  cover.format = gl::Format::R32UI;
  cover.width = world_.cover.width();
  cover.height = world_.cover.height();
  cover.sampling = {gl::Filter::Nearest, gl::Filter::Nearest};
  if (auto r = assign(cover_, gl::Texture::create(context, cover)); !r) return r;
  cover_.upload(std::span(world_.cover.texels()));

  if (auto r = buildPrograms(context); !r) return r;
  if (!world_.plants.empty()) {
    if (auto r = buildFoliage(context); !r) return r;
  }
  if (const EffectSettings* vehicles = findEffect(effects_, Effect::Vehicles)) {
    if (auto r = buildTraffic(context, *vehicles); !r) return r;
  }
  if (shadows_) return buildShadows(context);
  return {};
}

Result<void> GeometryPass::buildPrograms(gl::Context& context) {
  const auto make = [&](gl::Program& program, std::initializer_list<ShaderFile> vertex,
                        std::initializer_list<ShaderFile> fragment) {
    return assign(program, gl::Program::raster(context, std::span(vertex.begin(), vertex.size()),
                                               std::span(fragment.begin(), fragment.size()), defines_));
  };
  if (auto r =
          make(ground_program_, {kCamera, {"ground.vert", text::ground_vert}},
               {kCover, kNoise, kMaterial, kResponse, kLight, kSurface, {"ground.frag", text::ground_frag}});
      !r)
    return r;
  if (!world_.solids.indices.empty() || findEffect(effects_, Effect::Vehicles)) {
    if (auto r =
            make(solid_program_, {kCamera, {"solid.vert", text::solid_vert}},
                 {kCover, kNoise, kMaterial, kResponse, kLight, kSurface, {"solid.frag", text::solid_frag}});
        !r)
      return r;
  }
  if (!world_.plants.empty()) {
    return make(foliage_program_, {kCamera, {"foliage.vert", text::foliage_vert}},
                {kNoise, kFoliage, kResponse, kLight, {"foliage.frag", text::foliage_frag}});
  }
  return {};
}

Result<void> GeometryPass::buildFoliage(gl::Context& context) {
  std::array<int, 4> plants{};
  for (const amplify::Plant& plant : world_.plants) {
    ++plants[plant.species];
    tallest_m_ = std::max(tallest_m_, 1.25 * plant.height);
  }
  // Room for every plant there is in any ring; a few more, because float and double may decide differently.
  const int capacity = *std::max_element(plants.begin(), plants.end()) + 64;
  auto selector = amplify::PlantSelector::create(context, world_.population, world_.terrain.grid(), capacity);
  if (!selector) return tl::unexpected<Error>(selector.error());
  selector_ = std::move(*selector);
  for (std::size_t bin = 0; bin < foliage_.size(); ++bin) {
    const std::size_t species = bin / 3 + 1;
    if (plants[species] == 0) continue;
    std::vector<FoliageVertex> vertices;
    std::vector<std::uint32_t> indices;
    std::uint32_t number = 0;
    for (const FoliagePolygon& polygon :
         foliageOf(static_cast<amplify::Species>(species), static_cast<int>(bin % 3))) {
      const auto first = static_cast<std::uint32_t>(vertices.size());
      for (const auto& [x, y] :
           {std::pair(-1.0f, -1.0f), std::pair(1.0f, -1.0f), std::pair(1.0f, 1.0f), std::pair(-1.0f, 1.0f)}) {
        vertices.push_back({{x, y},
                            {polygon.centre.x(), polygon.centre.y(), polygon.centre.z()},
                            {polygon.u_axis.x(), polygon.u_axis.y(), polygon.u_axis.z()},
                            {polygon.v_axis.x(), polygon.v_axis.y(), polygon.v_axis.z()},
                            {polygon.normal.x(), polygon.normal.y(), polygon.normal.z()},
                            number});
      }
      indices.insert(indices.end(), {first, first + 1, first + 2, first, first + 2, first + 3});
      ++number;
    }
    Foliage& foliage = foliage_[bin];
    foliage.count = static_cast<int>(indices.size());
    if (auto r = assign(foliage.polygons,
                        gl::Buffer::from(context, std::span(std::as_const(vertices)), gl::BufferUse::Static));
        !r)
      return r;
    if (auto r = assign(foliage.indices,
                        gl::Buffer::from(context, std::span(std::as_const(indices)), gl::BufferUse::Static));
        !r)
      return r;
    constexpr std::size_t kStride = sizeof(FoliageVertex), kPlant = sizeof(amplify::Plant);
    const std::size_t first = bin * static_cast<std::size_t>(capacity) * kPlant;
    const gl::Buffer *v = &foliage.polygons, *i = &selector_->instances();
    using Type = gl::AttributeType;
    const std::array<gl::Attribute, 9> attributes{
        {{0, v, Type::Float, 2, kStride, offsetof(FoliageVertex, corner)},
         {1, v, Type::Float, 3, kStride, offsetof(FoliageVertex, centre)},
         {2, v, Type::Float, 3, kStride, offsetof(FoliageVertex, u_axis)},
         {3, v, Type::Float, 3, kStride, offsetof(FoliageVertex, v_axis)},
         {4, v, Type::Float, 3, kStride, offsetof(FoliageVertex, normal)},
         {5, v, Type::U32, 1, kStride, offsetof(FoliageVertex, polygon)},
         {6, i, Type::Float, 4, kPlant, first + offsetof(amplify::Plant, east), true},
         {7, i, Type::Float, 2, kPlant, first + offsetof(amplify::Plant, radius), true},
         {8, i, Type::U32, 2, kPlant, first + offsetof(amplify::Plant, species), true}}};
    if (auto r = assign(foliage.vertices, gl::VertexArray::create(context, attributes, &foliage.indices)); !r)
      return r;
  }
  return {};
}

Result<void> GeometryPass::buildTraffic(gl::Context& context, const EffectSettings& settings) {
  auto vehicles = std::make_unique<Vehicles>(Vehicles{Traffic(world_, settings), {}, {}, {}, 0});
  const Mesh mesh = vehicles->traffic.meshAt(0);
  if (mesh.indices.empty()) return {};  // no streets
  vehicles->count = static_cast<int>(mesh.indices.size());
  if (auto r = assign(vehicles->vertices, gl::Buffer::from(context, std::span(mesh.vertices))); !r) return r;
  if (auto r = assign(vehicles->indices, gl::Buffer::from(context, std::span(mesh.indices))); !r) return r;
  if (auto r = assign(vehicles->array, meshVertices(context, vehicles->vertices, vehicles->indices)); !r)
    return r;
  vehicles_ = std::move(vehicles);
  return {};
}

Result<void> GeometryPass::buildShadows(gl::Context& context) {
  gl::TextureSpec spec;
  spec.format = gl::Format::Depth32F;
  spec.width = spec.height = static_cast<int>((*shadows_)["map_size"]);
  spec.sampling = {gl::Filter::Nearest, gl::Filter::Nearest};
  if (auto r = assign(shadow_map_, gl::Texture::create(context, spec)); !r) return r;
  if (auto r = assign(shadow_target_, gl::Framebuffer::create(context, {}, {&shadow_map_})); !r) return r;
  const std::array<ShaderFile, 2> vertex{kShadow, {"shadow_mesh.vert", text::shadow_mesh_vert}};
  const std::array<ShaderFile, 1> fragment{{{"shadow_mesh.frag", text::shadow_mesh_frag}}};
  if (auto r = assign(shadow_program_, gl::Program::raster(context, vertex, fragment)); !r) return r;
  if (!world_.plants.empty()) {
    std::vector<gl::Define> defines{{"SHADOW_MAP"}};
    if (wind_) defines.push_back({"WIND_SWAY"});
    const std::array<ShaderFile, 2> leaf_vertex{kShadow, {"foliage.vert", text::foliage_vert}};
    const std::array<ShaderFile, 3> leaf_fragment{kNoise, kFoliage, {"foliage.frag", text::foliage_frag}};
    if (auto r = assign(shadow_foliage_program_,
                        gl::Program::raster(context, leaf_vertex, leaf_fragment, defines));
        !r)
      return r;
  }
  // The light looks down its -z; x and y are any two axes across.
  const Eigen::Vector3d z = world_.towards_sun;
  const Eigen::Vector3d x = (std::abs(z.z()) < 0.99 ? Eigen::Vector3d(Eigen::Vector3d::UnitZ())
                                                    : Eigen::Vector3d(Eigen::Vector3d::UnitY()))
                                .cross(z)
                                .normalized();
  sun_.light_from_scene.row(0) = x.transpose();
  sun_.light_from_scene.row(1) = z.cross(x).transpose();
  sun_.light_from_scene.row(2) = z.transpose();
  return {};
}

namespace {

void extendBy(const Eigen::Matrix3d& light_from_scene, const Eigen::AlignedBox3f& box, Eigen::Vector3d& low,
              Eigen::Vector3d& high) {
  for (int i = 0; i < 8; ++i) {
    const Eigen::Vector3d p =
        light_from_scene * box.corner(static_cast<Eigen::AlignedBox3f::CornerType>(i)).cast<double>();
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
}

// Rings of detail as in the paper, where the viewer is about 100 m up, scaled to the drone's height.
Eigen::Vector3d ringsOf(const World& world) {
  const double scale = (world.description.path.height - world.description.path.ground) / 100;
  return scale * Eigen::Vector3d(700, 1400, 3000);
}

// The picture's pyramid, widened by `margin` pictures on every side.
amplify::PlantView plantView(const World& world, const View& view, double margin) {
  const RenderCamera& c = view.camera;
  const double mx = margin * c.width, my = margin * c.height;
  const std::array<Eigen::Vector3d, 6> inward{{{c.fx, 0, c.cx + mx},
                                               {-c.fx, 0, c.width - c.cx + mx},
                                               {0, c.fy, c.cy + my},
                                               {0, -c.fy, c.height - c.cy + my},
                                               {0, 0, 1},
                                               {0, 0, 1}}};
  amplify::PlantView plants;
  plants.eye = view.state.position;
  plants.rings = ringsOf(world);
  for (std::size_t i = 0; i < inward.size(); ++i) {
    const Eigen::Vector3d normal = view.state.enu_from_camera * inward[i].normalized();
    plants.planes[i] = {normal.x(), normal.y(), normal.z(), -normal.dot(view.state.position)};
  }
  return plants;
}

}  // namespace

Result<void> GeometryPass::drawShadowMap(const View& view) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  Eigen::Vector3d low = Eigen::Vector3d::Constant(kInfinity), high = -low;
  for (const Mesh* mesh : {&world_.ground, &world_.solids}) {
    for (const Chunk& chunk : mesh->chunks) {
      if (view.sees(chunk.box, 0.02)) extendBy(sun_.light_from_scene, chunk.box, low, high);
    }
  }
  if (!(low.x() < high.x())) return {};
  // What may throw a shadow into that rectangle.
  Eigen::Vector3d depth_low = low, depth_high = high;
  const auto casts = [&](const Eigen::AlignedBox3f& box) {
    Eigen::Vector3d a = Eigen::Vector3d::Constant(kInfinity), b = -a;
    extendBy(sun_.light_from_scene, box, a, b);
    if (a.x() > high.x() || b.x() < low.x() || a.y() > high.y() || b.y() < low.y() || b.z() < low.z())
      return false;
    depth_low = depth_low.cwiseMin(a);
    depth_high = depth_high.cwiseMax(b);
    return true;
  };
  const std::vector<IndexRun> ground = runsOf(world_.ground, casts), solids = runsOf(world_.solids, casts);
  depth_high.z() += tallest_m_;
  sun_.low = {low.x(), low.y(), depth_low.z() - 1};
  sun_.high = {high.x(), high.y(), depth_high.z() + 1};

  const Eigen::Vector3d size = sun_.high - sun_.low;
  // Depth grows away from the sun.
  const Eigen::Vector3d scale(2 / size.x(), 2 / size.y(), -2 / size.z());
  const Eigen::Vector3d offset(-1 - scale.x() * sun_.low.x(), -1 - scale.y() * sun_.low.y(),
                               -1 - scale.z() * sun_.high.z());
  const auto set = [&](gl::Program& program) {
    program.set("light_from_scene_rotation", Eigen::Matrix3f(sun_.light_from_scene.cast<float>()));
    program.set("light_ndc_scale", Eigen::Vector3f(scale.cast<float>()));
    program.set("light_ndc_offset", Eigen::Vector3f(offset.cast<float>()));
  };
  shadow_target_.clearDepth(1);
  gl::DrawState state;
  state.depth_test = state.depth_write = true;
  set(shadow_program_);
  for (const IndexRun& run : ground)
    gl::draw(shadow_program_, shadow_target_, ground_, run.count, 1, state, gl::Topology::Triangles,
             run.first);
  for (const IndexRun& run : solids)
    gl::draw(shadow_program_, shadow_target_, solids_, run.count, 1, state, gl::Topology::Triangles,
             run.first);
  if (vehicles_) gl::draw(shadow_program_, shadow_target_, vehicles_->array, vehicles_->count, 1, state);
  if (!world_.plants.empty()) {
    set(shadow_foliage_program_);
    amplify::PlantView plants;
    plants.eye = view.state.position;
    plants.rings = ringsOf(world_);
    const auto plane = [&](Eigen::Index axis, double sign, double bound) {
      const Eigen::Vector3d normal = sign * sun_.light_from_scene.row(axis).transpose();
      return Eigen::Vector4d(normal.x(), normal.y(), normal.z(), -sign * bound);
    };
    plants.planes = {plane(0, 1, low.x()),   plane(0, -1, high.x()), plane(1, 1, low.y()),
                     plane(1, -1, high.y()), {0, 0, 1, 1e6},         {0, 0, 1, 1e6}};
    if (auto r = drawPlants(shadow_foliage_program_, shadow_target_, plants, false); !r) return r;
  }
  ++counts_.passes;
  return {};
}

Result<void> GeometryPass::drawPlants(gl::Program& program, gl::Framebuffer& target,
                                      const amplify::PlantView& view, bool count) {
  const auto counts = selector_->select(view);
  if (!counts) return tl::unexpected<Error>(counts.error());
  gl::DrawState state;
  state.depth_test = state.depth_write = true;
  for (std::size_t bin = 0; bin < foliage_.size(); ++bin) {
    const int instances = (*counts)[bin];
    if (instances == 0 || foliage_[bin].count == 0) continue;
    gl::draw(program, target, foliage_[bin].vertices, foliage_[bin].count, instances, state);
    if (!count) continue;
    ++counts_.draws;
    counts_.plants += static_cast<std::size_t>(instances);
    counts_.triangles +=
        static_cast<std::size_t>(foliage_[bin].count) / 3 * static_cast<std::size_t>(instances);
  }
  return {};
}

void GeometryPass::setView(gl::Program& program, const View& view) {
  const RenderCamera& c = view.camera;
  program.set("camera_from_scene_rotation",
              Eigen::Matrix3f(view.state.enu_from_camera.conjugate().toRotationMatrix().cast<float>()));
  program.set("camera_in_scene", Eigen::Vector3f(view.state.position.cast<float>()));
  program.set("projection", Eigen::Vector4d(2 * c.fx / c.width, 2 * c.fy / c.height, 2 * c.cx / c.width - 1,
                                            2 * c.cy / c.height - 1)
                                .cast<float>()
                                .eval());
  program.set("depth_range", Eigen::Vector2d((view.far_m + view.near_m) / (view.far_m - view.near_m),
                                             -2 * view.far_m * view.near_m / (view.far_m - view.near_m))
                                 .cast<float>()
                                 .eval());
  if (!rolling_) return;
  program.set("velocity", Eigen::Vector3f(view.motion.velocity.cast<float>()));
  program.set("rotation", Eigen::Vector3f(view.motion.rotation.cast<float>()));
  // y_ndc of the sensor runs from -1 in the first row's upper edge to 1: half the rows a unit.
  const double line_time_s = (*rolling_)["line_time_us"] * 1e-6;
  program.set("row_time", Eigen::Vector2d(0.5 * sensor_.height * line_time_s, 0).cast<float>().eval());
  if (!distortion_) return;
  const std::array<float, 5> k{
      static_cast<float>((*distortion_)["k1"]), static_cast<float>((*distortion_)["k2"]),
      static_cast<float>((*distortion_)["p1"]), static_cast<float>((*distortion_)["p2"]),
      static_cast<float>((*distortion_)["k3"])};
  program.set("distortion", std::span<const float>(k));
  program.set("sensor_projection",
              Eigen::Vector2d(2 * sensor_.fy / sensor_.height, 2 * sensor_.cy / sensor_.height - 1)
                  .cast<float>()
                  .eval());
}

void GeometryPass::setLight(gl::Program& program, const View& view) {
  program.set("towards_sun", Eigen::Vector3f(world_.towards_sun.cast<float>()));
  if (specular_) {
    program.set("eye", Eigen::Vector3f(view.state.position.cast<float>()));
    program.set("specular", Eigen::Vector3d((*specular_)["strength"], (*specular_)["roughness"], view.time_s)
                                .cast<float>()
                                .eval());
  }
  if (!shadows_) return;
  const double texels = shadow_map_.width();
  const Eigen::Vector3d size = sun_.high - sun_.low;
  const Eigen::Vector3d scale(texels / size.x(), texels / size.y(), -1 / size.z());
  const Eigen::Vector3d offset(-scale.x() * sun_.low.x(), -scale.y() * sun_.low.y(),
                               -scale.z() * sun_.high.z());
  program.setTexture("shadow_map", 1, shadow_map_);
  program.set("light_from_scene_rotation", Eigen::Matrix3f(sun_.light_from_scene.cast<float>()));
  program.set("light_scale", Eigen::Vector3f(scale.cast<float>()));
  program.set("light_offset", Eigen::Vector3f(offset.cast<float>()));
  program.set("shadow_texel_metres", static_cast<float>(std::max(size.x(), size.y()) / texels));
}

Result<void> GeometryPass::draw(View& view) {
  counts_ = {};
  if (vehicles_) {
    const Mesh mesh = vehicles_->traffic.meshAt(view.time_s);
    vehicles_->vertices.upload(std::span(mesh.vertices));
    vehicles_->indices.upload(std::span(mesh.indices));
  }
  const double margin = rolling_ ? 0.1 : 0.005;
  double near = std::numeric_limits<double>::infinity(), far = 1;
  const auto seen = [&](const Eigen::AlignedBox3f& box) {
    if (!view.sees(box, margin)) return false;
    Eigen::AlignedBox3f grown = box;  // plants stand on it
    grown.max().z() += static_cast<float>(tallest_m_);
    const auto [low, high] = view.depthsOf(grown);
    near = std::min(near, low);
    far = std::max(far, high);
    return true;
  };
  const std::vector<IndexRun> ground = runsOf(world_.ground, seen), solids = runsOf(world_.solids, seen);
  view.near_m = std::isfinite(near) ? std::max(0.2, 0.95 * near) : 0.2;
  view.far_m = std::max(view.near_m + 1, 1.05 * far);
  if (shadows_) {
    if (auto r = drawShadowMap(view); !r) return r;
  }

  samples_.clearColor(0, 0.62f, 0.72f, 0.82f, 1);  // sky, and ground beyond the scene's border
  samples_.clearDepth(1);
  gl::DrawState state;
  state.depth_test = state.depth_write = true;
  const auto drawRuns = [&](gl::Program& program, const gl::VertexArray& array,
                            const std::vector<IndexRun>& runs) {
    for (const IndexRun& run : runs) {
      gl::draw(program, samples_, array, run.count, 1, state, gl::Topology::Triangles, run.first);
      ++counts_.draws;
      counts_.triangles += static_cast<std::size_t>(run.count) / 3;
    }
  };
  const auto prepare = [&](gl::Program& program) {
    setView(program, view);
    setLight(program, view);
  };
  // What hides the most first; the ground, dearest a pixel, last.
  if (!solids.empty() || vehicles_) prepare(solid_program_);
  drawRuns(solid_program_, solids_, solids);
  if (vehicles_) drawRuns(solid_program_, vehicles_->array, {{0, vehicles_->count}});
  if (!world_.plants.empty()) {
    prepare(foliage_program_);
    if (wind_) {
      foliage_program_.set("wind", Eigen::Vector3d(6.283185307 * view.time_s / (*wind_)["period_s"],
                                                   (*wind_)["amplitude_m"], 0.05)
                                       .cast<float>()
                                       .eval());
    }
    if (auto r = drawPlants(foliage_program_, samples_, plantView(world_, view, margin), true); !r) return r;
  }
  prepare(ground_program_);
  ground_program_.setTexture("cover_map", 0, cover_);
  ground_program_.set("cover_origin", Eigen::Vector2f(world_.cover.origin().cast<float>()));
  ground_program_.set("cover_texels_per_metre", static_cast<float>(1.0 / world_.cover.texel()));
  ground_program_.set("kerb_width", static_cast<float>(world_.description.pavement));
  ground_program_.set("street_lines", world_.description.street_lines ? 1.0f : 0.0f);
  drawRuns(ground_program_, ground_, ground);
  gl::resolve(samples_, resolved_);
  ++counts_.passes;
  return {};
}

}  // namespace overfly::scene
