#pragma once
#include <span>
#include <vector>

#include "config/error.h"
#include "render/gl/context.h"
#include "render/gl/texture.h"

namespace overfly::gl {

// One colour or depth target: a level of a texture, and a layer of it when it is an array. The texture must
// outlive the framebuffer.
struct Attachment {
  const Texture* texture = nullptr;
  int level = 0;
  int layer = 0;
};

// Render targets. Row 0 of memory is row 0 of the picture: no flips anywhere. Thread-bound to its context.
class Framebuffer {
 public:
  Framebuffer() = default;
  // Unsupported when this GPU cannot render into this combination (see DeviceInfo::support).
  [[nodiscard]] static Result<Framebuffer> create(Context& context, std::span<const Attachment> color,
                                                  const Attachment& depth = {});
  [[nodiscard]] static Result<Framebuffer> create(Context& context, const Texture& color) {
    const Attachment one{&color, 0, 0};
    return create(context, std::span<const Attachment>(&one, 1));
  }

  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  [[nodiscard]] bool empty() const { return object_.empty(); }

  void clearColor(int index, float r, float g, float b, float a);
  void clearColorUint(int index, unsigned r, unsigned g, unsigned b, unsigned a);
  void clearColorInt(int index, int r, int g, int b, int a);
  void clearDepth(float depth);

  [[nodiscard]] const detail::Object& object() const { return object_; }

 private:
  detail::Object object_;
  int width_ = 0, height_ = 0;
};

}  // namespace overfly::gl
