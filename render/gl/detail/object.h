#pragma once
#include <memory>

namespace overfly::gl::detail {

class ContextState;
using StatePtr = std::shared_ptr<ContextState>;

enum class ObjectKind { Texture, Buffer, Framebuffer, Program, VertexArray, Query };

// One GL name, owned. Move-only. Every access makes sure that this is the context's thread and that the
// context is current.
class Object {
 public:
  Object() = default;
  Object(StatePtr state, ObjectKind kind, unsigned name);
  ~Object();
  Object(Object&& other) noexcept;
  Object& operator=(Object&& other) noexcept;

  [[nodiscard]] unsigned name() const;
  [[nodiscard]] ContextState& state() const { return *state_; }
  [[nodiscard]] const StatePtr& statePtr() const { return state_; }
  [[nodiscard]] bool empty() const { return name_ == 0; }

 private:
  void release() noexcept;
  StatePtr state_;
  ObjectKind kind_ = ObjectKind::Texture;
  unsigned name_ = 0;
};

}  // namespace overfly::gl::detail
