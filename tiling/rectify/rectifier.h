#pragma once
#include <deque>
#include <map>
#include <vector>

#include "capture/frame.h"
#include "config/error.h"
#include "render/gl/commands.h"
#include "tiling/rectify/rectified_frame.h"
#include "tiling/rectify/undistortion.h"

namespace overfly::tiling {

struct RectifyOptions {
  UndistortionOptions undistortion;
  bool quads = false;  // also make RectifiedFrame::quads: 5.3 bytes of GPU memory more per pixel
};

// Takes frames to the GPU, once each: conversion, undistortion, luminance, mips and statistics. Keeps maps
// and staging textures of the last cameras. Thread-bound to its GL context, which must outlive it.
class Rectifier {
 public:
  [[nodiscard]] static Result<Rectifier> create(gl::Context& context, const RectifyOptions& options = {});

  // BadInput: no usable image or camera, or their sizes differ. Unavailable: GPU memory or context.
  [[nodiscard]] Result<RectifiedFrame> rectify(std::uint64_t id, const capture::Frame& frame);

 private:
  struct Map {
    capture::CameraModel camera;
    capture::CameraModel pinhole;
    int step = 0;
    gl::Texture grid;
  };

  Rectifier(gl::Context& context, const RectifyOptions& options) : context_(&context), options_(options) {}
  [[nodiscard]] Result<Map*> mapOf(const capture::CameraModel& camera);
  [[nodiscard]] Result<void> upload(const capture::Image& image);
  [[nodiscard]] Result<gl::Program*> programOf(capture::PixelFormat format);
  [[nodiscard]] Result<void> packQuads(RectifiedFrame& frame);
  [[nodiscard]] Result<LumaStats> statsOf(const RectifiedFrame& frame);

  gl::Context* context_;
  RectifyOptions options_;
  std::deque<Map> maps_;  // newest first
  gl::Texture plane0_, plane1_;
  std::map<capture::PixelFormat, gl::Program> programs_;
  gl::Program pack_quads_, luma_stats_;
};

}  // namespace overfly::tiling
