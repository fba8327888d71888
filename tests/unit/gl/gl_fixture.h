#pragma once
// Base of every test that draws: one context per test program, made with debugging on in every build; a
// test that leaves a GL error behind fails.
#include <gtest/gtest.h>

#include <memory>

#include "render/gl/context.h"

namespace overfly::test {

inline gl::Context& sharedContext() {
  static const auto context = [] {
    gl::ContextOptions options;
    options.debug = true;
    auto made = gl::Context::create(options);
    if (!made) throw std::runtime_error(made.error().message);
    return std::make_unique<gl::Context>(std::move(*made));
  }();
  return *context;
}

class GlTest : public ::testing::Test {
 protected:
  void SetUp() override { static_cast<void>(context().takeErrors()); }
  void TearDown() override {
    for (const std::string& error : context().takeErrors()) ADD_FAILURE() << "GL error: " << error;
  }
  static gl::Context& context() { return sharedContext(); }
};

// The value, or the error's message as a test failure.
#define OVERFLY_ASSERT_OK(variable, expression)                                    \
  auto variable##_result = (expression);                                           \
  ASSERT_TRUE(variable##_result.has_value()) << variable##_result.error().message; \
  auto& variable = *variable##_result

}  // namespace overfly::test
