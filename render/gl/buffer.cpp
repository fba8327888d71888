#include "render/gl/buffer.h"

#include <fmt/core.h>

#include <cstring>
#include <stdexcept>
#include <vector>

#include "render/gl/detail/context_state.h"

namespace overfly::gl {
namespace {

// Not a binding point that a draw or a dispatch reads, so that no other state is disturbed.
constexpr GLenum kTarget = GL_COPY_WRITE_BUFFER;

GLenum usage(BufferUse use) {
  switch (use) {
    case BufferUse::Static:
      return GL_STATIC_DRAW;
    case BufferUse::Dynamic:
      return GL_DYNAMIC_DRAW;
    case BufferUse::ReadBack:
      return GL_DYNAMIC_READ;
  }
  return GL_DYNAMIC_DRAW;
}

void requireInside(std::size_t offset, std::size_t count, std::size_t size) {
  if (offset > size || count > size - offset) {
    throw std::logic_error(
        fmt::format("GL buffer range {}+{} lies outside its {} bytes", offset, count, size));
  }
}

}  // namespace

Result<Buffer> Buffer::create(Context& context, std::size_t bytes, BufferUse use) {
  return fromBytes(context, {static_cast<const std::byte*>(nullptr), bytes}, use);
}

Result<Buffer> Buffer::fromBytes(Context& context, std::span<const std::byte> values, BufferUse use) {
  detail::ContextState& state = *context.state();
  state.collectErrors();
  state.out_of_memory = false;
  GLuint name = 0;
  glGenBuffers(1, &name);
  Buffer out;
  out.object_ = detail::Object(context.state(), detail::ObjectKind::Buffer, name);
  out.bytes_ = values.size();
  glBindBuffer(kTarget, name);
  glBufferData(kTarget, static_cast<GLsizeiptr>(values.size()), values.data(), usage(use));
  if (auto made = state.outcome("Creating a buffer"); !made) return tl::unexpected(made.error());
  if (values.data() == nullptr) out.clear();
  return out;
}

void Buffer::uploadBytes(std::span<const std::byte> values, std::size_t offset) {
  requireInside(offset, values.size(), bytes_);
  if (values.empty()) return;
  glBindBuffer(kTarget, object_.name());
  glBufferSubData(kTarget, static_cast<GLintptr>(offset), static_cast<GLsizeiptr>(values.size()),
                  values.data());
}

Result<void> Buffer::downloadBytes(std::span<std::byte> values, std::size_t offset) const {
  requireInside(offset, values.size(), bytes_);
  if (values.empty()) return {};
  glBindBuffer(kTarget, object_.name());
  glMemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT);
  const void* mapped = glMapBufferRange(kTarget, static_cast<GLintptr>(offset),
                                        static_cast<GLsizeiptr>(values.size()), GL_MAP_READ_BIT);
  if (mapped == nullptr) {
    if (auto done = object_.state().outcome("Reading a buffer"); !done) return done;
    return fail(ErrorCode::Unavailable, "Reading a buffer: the driver refused to map it");
  }
  std::memcpy(values.data(), mapped, values.size());
  glUnmapBuffer(kTarget);
  return object_.state().outcome("Reading a buffer");
}

void Buffer::clear() {
  glBindBuffer(kTarget, object_.name());
  if (bytes_ == 0) return;
  void* mapped = glMapBufferRange(kTarget, 0, static_cast<GLsizeiptr>(bytes_),
                                  GL_MAP_WRITE_BIT | GL_MAP_INVALIDATE_BUFFER_BIT);
  if (mapped == nullptr) return;  // lost or out of memory: the next check says so
  std::memset(mapped, 0, bytes_);
  glUnmapBuffer(kTarget);
}

void Buffer::bindStorage(int binding) const {
  glBindBufferBase(GL_SHADER_STORAGE_BUFFER, static_cast<GLuint>(binding), object_.name());
}

void Buffer::bindStorageRange(int binding, std::size_t offset, std::size_t bytes) const {
  requireInside(offset, bytes, bytes_);
  glBindBufferRange(GL_SHADER_STORAGE_BUFFER, static_cast<GLuint>(binding), object_.name(),
                    static_cast<GLintptr>(offset), static_cast<GLsizeiptr>(bytes));
}

void Buffer::bindUniform(int binding) const {
  glBindBufferBase(GL_UNIFORM_BUFFER, static_cast<GLuint>(binding), object_.name());
}

}  // namespace overfly::gl
