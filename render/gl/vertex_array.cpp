#include "render/gl/vertex_array.h"

#include "render/gl/detail/context_state.h"

namespace overfly::gl {

Result<VertexArray> VertexArray::create(Context& context, std::span<const Attribute> attributes,
                                        const Buffer* indices) {
  detail::ContextState& state = *context.state();
  state.bind();
  GLuint name = 0;
  glGenVertexArrays(1, &name);
  VertexArray out;
  out.object_ = detail::Object(context.state(), detail::ObjectKind::VertexArray, name);
  out.indexed_ = indices != nullptr;
  glBindVertexArray(name);
  for (const Attribute& one : attributes) {
    const auto location = static_cast<GLuint>(one.location);
    const auto stride = static_cast<GLsizei>(one.stride);
    const void* offset = reinterpret_cast<const void*>(one.offset);  // GL's way to say a byte offset
    glBindBuffer(GL_ARRAY_BUFFER, one.buffer->object().name());
    glEnableVertexAttribArray(location);
    switch (one.type) {
      case AttributeType::Float:
        glVertexAttribPointer(location, one.components, GL_FLOAT, GL_FALSE, stride, offset);
        break;
      case AttributeType::U8Normalised:
        glVertexAttribPointer(location, one.components, GL_UNSIGNED_BYTE, GL_TRUE, stride, offset);
        break;
      case AttributeType::U32:
        glVertexAttribIPointer(location, one.components, GL_UNSIGNED_INT, stride, offset);
        break;
      case AttributeType::I32:
        glVertexAttribIPointer(location, one.components, GL_INT, stride, offset);
        break;
    }
    glVertexAttribDivisor(location, one.per_instance ? 1 : 0);
  }
  if (indices != nullptr) glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, indices->object().name());
  glBindVertexArray(0);
  if (auto made = state.outcome("Creating a vertex array"); !made) return tl::unexpected(made.error());
  return out;
}

}  // namespace overfly::gl
