#include "render/gl/detail/object.h"

#include <utility>

#include "render/gl/detail/context_state.h"

namespace overfly::gl::detail {

Object::Object(StatePtr state, ObjectKind kind, unsigned name)
    : state_(std::move(state)), kind_(kind), name_(name) {}

Object::~Object() { release(); }

Object::Object(Object&& other) noexcept
    : state_(std::move(other.state_)), kind_(other.kind_), name_(std::exchange(other.name_, 0)) {}

Object& Object::operator=(Object&& other) noexcept {
  if (this != &other) {
    release();
    state_ = std::move(other.state_);
    kind_ = other.kind_;
    name_ = std::exchange(other.name_, 0);
  }
  return *this;
}

unsigned Object::name() const {
  if (state_) state_->bind();
  return name_;
}

void Object::release() noexcept {
  if (name_ == 0 || !state_ || !state_->alive) return;
  state_->bind();
  switch (kind_) {
    case ObjectKind::Texture:
      glDeleteTextures(1, &name_);
      break;
    case ObjectKind::Buffer:
      glDeleteBuffers(1, &name_);
      break;
    case ObjectKind::Framebuffer:
      glDeleteFramebuffers(1, &name_);
      break;
    case ObjectKind::Program:
      glDeleteProgram(name_);
      break;
    case ObjectKind::VertexArray:
      glDeleteVertexArrays(1, &name_);
      break;
    case ObjectKind::Query:
      glDeleteQueries(1, &name_);
      break;
  }
  name_ = 0;
}

}  // namespace overfly::gl::detail
