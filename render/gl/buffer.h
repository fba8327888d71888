#pragma once
#include <cstddef>
#include <span>
#include <type_traits>

#include "config/error.h"
#include "render/gl/context.h"

namespace overfly::gl {

enum class BufferUse { Static, Dynamic, ReadBack };

// Memory of the GPU, typed at each access by the span given. Layouts are the caller's: std430 for storage,
// std140 for uniform blocks. Thread-bound to its context.
class Buffer {
 public:
  Buffer() = default;
  // Zero-filled. Unavailable: out of memory or context lost.
  [[nodiscard]] static Result<Buffer> create(Context& context, std::size_t bytes,
                                             BufferUse use = BufferUse::Dynamic);
  template <typename T>
  [[nodiscard]] static Result<Buffer> from(Context& context, std::span<const T> values,
                                           BufferUse use = BufferUse::Dynamic) {
    static_assert(std::is_trivially_copyable_v<T>);
    return fromBytes(context, std::as_bytes(values), use);
  }

  [[nodiscard]] std::size_t bytes() const { return bytes_; }
  [[nodiscard]] bool empty() const { return object_.empty(); }

  // Writes from byte `offset` on; the range must lie inside (a programming error otherwise).
  template <typename T>
  void upload(std::span<const T> values, std::size_t offset = 0) {
    static_assert(std::is_trivially_copyable_v<T>);
    uploadBytes(std::as_bytes(values), offset);
  }
  // Reads back after all submitted work. Unavailable when the context was lost meanwhile.
  template <typename T>
  [[nodiscard]] Result<void> download(std::span<T> values, std::size_t offset = 0) const {
    static_assert(std::is_trivially_copyable_v<T>);
    return downloadBytes(std::as_writable_bytes(values), offset);
  }
  void clear();  // to zero

  void bindStorage(int binding) const;
  void bindStorageRange(int binding, std::size_t offset, std::size_t bytes) const;
  void bindUniform(int binding) const;

  [[nodiscard]] const detail::Object& object() const { return object_; }

 private:
  [[nodiscard]] static Result<Buffer> fromBytes(Context& context, std::span<const std::byte> values,
                                                BufferUse use);
  void uploadBytes(std::span<const std::byte> values, std::size_t offset);
  [[nodiscard]] Result<void> downloadBytes(std::span<std::byte> values, std::size_t offset) const;

  detail::Object object_;
  std::size_t bytes_ = 0;
};

}  // namespace overfly::gl
