#include "render/scene/description.h"

#include <gtest/gtest.h>

#include <filesystem>

namespace overfly::scene {
namespace {

std::string messageOf(const std::string& toml) {
  const Result<SceneDescription> scene = parseScene(toml, "a.toml");
  EXPECT_FALSE(scene.has_value());
  if (scene) return "";
  EXPECT_EQ(scene.error().code, ErrorCode::BadSettings);
  return scene.error().message;
}

TEST(SceneFile, ErrorsNameFileLineAndKey) {
  EXPECT_EQ(messageOf("seed = 1\n[path]\nspeed = -3\n"),
            "a.toml:3: path.speed is -3; it must lie between 0.01 and 100");
  EXPECT_EQ(messageOf("[path]\nhight = 50\n"), "a.toml:2: path.hight is not a known key");
  EXPECT_EQ(messageOf("base = \"moss\"\n").substr(0, 27), "a.toml:1: base is \"moss\"; k");
  EXPECT_EQ(messageOf("[[street]]\npoints = [[0, 0], [1]]\n"),
            "a.toml:2: street.points must be a list of points of 2 numbers");
  EXPECT_EQ(messageOf("[camera\n").substr(0, 9), "a.toml:1:");
  EXPECT_EQ(messageOf("[terrain]\nkind = \"map\"\n"), "a.toml:1: terrain.map must name a file");
}

TEST(SceneFile, EffectsAreKnownNamedOnceAndOnlyTheyHaveParameters) {
  EXPECT_NE(messageOf("effects = [\"fog\"]\n").find("names \"fog\"; known are wind_sway"), std::string::npos);
  EXPECT_EQ(messageOf("effects = [\"haze\", \"haze\"]\n"), "a.toml:1: effects names \"haze\" twice");
  EXPECT_EQ(messageOf("effects = []\n[effect.haze]\nvisibility_m = 900\n"),
            "a.toml:2: effect.haze is not a known key");
  EXPECT_EQ(messageOf("effects = [\"haze\"]\n[effect.haze]\nvisibility = 900\n"),
            "a.toml:3: effect.haze.visibility is not a known key");
  const Result<SceneDescription> scene =
      parseScene("effects = [\"haze\"]\n[effect.haze]\nvisibility_m = 900\n", "a.toml");
  ASSERT_TRUE(scene.has_value());
  ASSERT_EQ(scene->effects.size(), 1u);
  EXPECT_EQ(scene->effects[0]["visibility_m"], 900);
}

TEST(SceneFile, AnEffectsSeedDependsOnItsNameAndTheSceneAlone) {
  const auto one = parseScene("effects = [\"sensor_noise\"]", "a"),
             two = parseScene("effects = [\"motion_blur\", \"haze\", \"sensor_noise\"]", "b");
  ASSERT_TRUE(one && two);
  EXPECT_EQ(findEffect(one->effects, Effect::SensorNoise)->seed,
            findEffect(two->effects, Effect::SensorNoise)->seed);
  EXPECT_NE(findEffect(two->effects, Effect::Haze)->seed,
            findEffect(two->effects, Effect::SensorNoise)->seed);
  const auto other = parseScene("seed = 2\neffects = [\"sensor_noise\"]", "a");
  EXPECT_NE(findEffect(one->effects, Effect::SensorNoise)->seed,
            findEffect(other->effects, Effect::SensorNoise)->seed);
}

TEST(SceneFile, AllShippedScenesLoadAndSayWhy) {
  int count = 0;
  for (const auto& entry : std::filesystem::directory_iterator(OVERFLY_SOURCE_DIR "/tests/data/scenes")) {
    if (entry.path().extension() != ".toml") continue;
    const Result<SceneDescription> scene = loadScene(entry.path());
    ASSERT_TRUE(scene.has_value()) << scene.error().message;
    EXPECT_EQ(scene->name, entry.path().stem().string());
    EXPECT_GT(scene->why.size(), 80u) << scene->name;
    ++count;
  }
  EXPECT_GE(count, 1);
}

}  // namespace
}  // namespace overfly::scene
