#include "render/gl/timer.h"

#include "render/gl/detail/context_state.h"

namespace overfly::gl {

Result<GpuTimer> GpuTimer::create(Context& context) {
  detail::ContextState& state = *context.state();
  state.bind();
  GpuTimer out;
  out.state_ = context.state();
  out.on_gpu_ = state.info.gpu_timer && !state.info.software;
  if (out.on_gpu_) {
    GLuint names[2] = {0, 0};
    glGenQueries(2, names);
    out.begin_ = detail::Object(context.state(), detail::ObjectKind::Query, names[0]);
    out.end_ = detail::Object(context.state(), detail::ObjectKind::Query, names[1]);
    GLint disjoint = 0;
    glGetIntegerv(GL_GPU_DISJOINT_EXT, &disjoint);  // resets the flag
  }
  if (auto made = state.outcome("Creating a timer"); !made) return tl::unexpected(made.error());
  return out;
}

void GpuTimer::start() {
  state_->bind();
  if (on_gpu_) {
    state_->query_counter(begin_.name(), GL_TIMESTAMP_EXT);
  } else {
    glFinish();
    cpu_begin_ = std::chrono::steady_clock::now();
  }
}

void GpuTimer::stop() {
  state_->bind();
  if (on_gpu_) {
    state_->query_counter(end_.name(), GL_TIMESTAMP_EXT);
  } else {
    glFinish();
    cpu_end_ = std::chrono::steady_clock::now();
  }
}

std::optional<std::chrono::nanoseconds> GpuTimer::elapsed() {
  if (!on_gpu_) return cpu_end_ - cpu_begin_;
  GLuint64 begin = 0, end = 0;
  state_->get_query_u64(begin_.name(), GL_QUERY_RESULT, &begin);
  state_->get_query_u64(end_.name(), GL_QUERY_RESULT, &end);
  GLint disjoint = 0;
  glGetIntegerv(GL_GPU_DISJOINT_EXT, &disjoint);
  if (disjoint != 0 || end < begin) return std::nullopt;
  return std::chrono::nanoseconds(static_cast<std::int64_t>(end - begin));
}

}  // namespace overfly::gl
