#include "render/gl/fence.h"

#include <algorithm>
#include <utility>

#include "render/gl/detail/context_state.h"

namespace overfly::gl {

Fence Fence::insert(Context& context) {
  context.state()->bind();
  Fence out;
  out.state_ = context.state();
  out.sync_ = glFenceSync(GL_SYNC_GPU_COMMANDS_COMPLETE, 0);
  glFlush();
  return out;
}

Fence::~Fence() { release(); }

Fence::Fence(Fence&& other) noexcept
    : state_(std::move(other.state_)), sync_(std::exchange(other.sync_, nullptr)) {}

Fence& Fence::operator=(Fence&& other) noexcept {
  if (this != &other) {
    release();
    state_ = std::move(other.state_);
    sync_ = std::exchange(other.sync_, nullptr);
  }
  return *this;
}

void Fence::release() noexcept {
  if (sync_ == nullptr || !state_->alive) return;
  state_->bind();
  glDeleteSync(static_cast<GLsync>(sync_));
  sync_ = nullptr;
}

bool Fence::done() const {
  if (sync_ == nullptr) return true;
  const auto now = wait(std::chrono::nanoseconds(0));
  return now && *now;
}

Result<bool> Fence::wait(std::chrono::nanoseconds timeout) const {
  if (sync_ == nullptr) return true;
  state_->bind();
  const auto limit = static_cast<GLuint64>(std::max<std::int64_t>(0, timeout.count()));
  const GLenum answer = glClientWaitSync(static_cast<GLsync>(sync_), GL_SYNC_FLUSH_COMMANDS_BIT, limit);
  if (answer == GL_WAIT_FAILED) {
    if (auto state = state_->outcome("Waiting for the GPU"); !state) return tl::unexpected(state.error());
    return fail(ErrorCode::Internal, "Waiting for the GPU failed");
  }
  return answer != GL_TIMEOUT_EXPIRED;
}

}  // namespace overfly::gl
