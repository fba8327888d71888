#pragma once
#include <cstdint>
#include <span>

#include "config/error.h"
#include "render/gl/buffer.h"
#include "render/gl/context.h"

namespace overfly::gl {

enum class AttributeType { Float, U8Normalised, U32, I32 };

// One vertex attribute, read from a buffer that must outlive the vertex array.
struct Attribute {
  int location = 0;  // layout(location = N) in the vertex shader
  const Buffer* buffer = nullptr;
  AttributeType type = AttributeType::Float;
  int components = 3;      // 1..4
  std::size_t stride = 0;  // bytes from one element to the next
  std::size_t offset = 0;  // bytes to the first
  bool per_instance = false;
};

// What a draw of geometry reads. Thread-bound to its context.
class VertexArray {
 public:
  VertexArray() = default;
  // `indices`: uint32 triangles' corners, or null for plain vertex order; must outlive the vertex array.
  [[nodiscard]] static Result<VertexArray> create(Context& context, std::span<const Attribute> attributes,
                                                  const Buffer* indices = nullptr);
  [[nodiscard]] bool indexed() const { return indexed_; }
  [[nodiscard]] const detail::Object& object() const { return object_; }

 private:
  detail::Object object_;
  bool indexed_ = false;
};

}  // namespace overfly::gl
