#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "tests/unit/house/house_rules.h"

namespace overfly::house {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

const fs::path kTree = OVERFLY_SOURCE_DIR;

TEST(House, IncludesPointDownOnly) { EXPECT_THAT(includeBreaches(kTree), IsEmpty()); }
TEST(House, LibrariesLinkDownOnly) { EXPECT_THAT(linkBreaches(kTree), IsEmpty()); }
TEST(House, ScriptsCanBeParsed) { EXPECT_THAT(scriptBreaches(kTree), IsEmpty()); }

// The checks themselves, on a tree that is made up to break the rules.
class MadeUpTree : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "overfly_house_XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    root_ = name;
  }
  void TearDown() override { fs::remove_all(root_); }
  void write(const fs::path& name, const std::string& text) {
    fs::create_directories((root_ / name).parent_path());
    std::ofstream(root_ / name) << text;
  }
  fs::path root_;
};

TEST_F(MadeUpTree, GoodIncludesPass) {
  write("config/a.h", "#include <vector>\n#include \"config/b.h\"\n");
  write("render/gl/egl.cpp", "#include <EGL/egl.h>\n#include <GLES3/gl31.h>\n#include \"capture/frame.h\"\n");
  write("tiling/store/db.cpp", "#include <sqlite3.h>\n#include \"render/gl/context.h\"\n");
  write("daemon/main.cpp", "#include \"tiling/store/store.h\"\n// #include is a word\n");
  EXPECT_THAT(includeBreaches(root_), IsEmpty());
}

TEST_F(MadeUpTree, EveryKindOfBadIncludeIsFound) {
  write("capture/a.h", "#pragma once\n  #  include \"tiling/store/store.h\"\n");
  write("capture/b.cpp", "#include <render/gl/context.h>\n");
  write("render/scene/c.cpp", "#include <GLES3/gl31.h>\n#include <EGL/egl.h>\n");
  write("render/gl/d.cpp", "#include \"../../tiling/e.h\"\n");
  write("tiling/sweep/f.cpp", "#include <sqlite3.h>\n#include \"daemon/link/g.h\"\n");
  write("config/h.cpp", "#include <toml++/toml.h>\n");
  EXPECT_THAT(includeBreaches(root_),
              ElementsAre("config/h.cpp:1: includes toml++/toml.h, which only config/detail/ may",
                          "capture/a.h:2: capture includes tiling/store/store.h, which stands above it",
                          "capture/b.cpp:1: capture includes render/gl/context.h, which stands above it",
                          HasSubstr("render/gl/d.cpp:1: includes \"../../tiling/e.h\" by a relative path"),
                          "render/scene/c.cpp:1: includes GLES3/gl31.h, which only render/gl/ may",
                          "render/scene/c.cpp:2: includes EGL/egl.h, which only render/gl/ may",
                          "tiling/sweep/f.cpp:1: includes sqlite3.h, which only tiling/store/ may",
                          "tiling/sweep/f.cpp:2: tiling includes daemon/link/g.h, which stands above it"));
}

TEST_F(MadeUpTree, ALibraryThatLinksUpwardsIsFound) {
  write("config/CMakeLists.txt", "overfly_library(config)\n");
  write("capture/CMakeLists.txt", "overfly_library(values DEPS overfly_config overfly_options)\n");
  write("render/gl/CMakeLists.txt",
        "# not overfly_store\noverfly_library(gl DEPS overfly_values\n  PRIVATE_DEPS overfly_store)\n");
  write("tiling/store/CMakeLists.txt", "overfly_library(store DEPS overfly_values)\n");
  EXPECT_THAT(
      linkBreaches(root_),
      ElementsAre("render/gl/CMakeLists.txt:3: render links overfly_store of tiling, which stands above it"));
}

TEST_F(MadeUpTree, ABrokenScriptIsFound) {
  const auto executable = fs::perms::owner_all;
  write("good", "#!/usr/bin/env bash\necho good\n");
  write("tools/broken", "#!/usr/bin/env bash\nif true; then\n");
  write("plain", "#!/usr/bin/env bash\necho plain\n");
  write("build/generated", "#!/bin/bash\nif\n");
  write("text", "if true; then\n");
  fs::permissions(root_ / "good", executable);
  fs::permissions(root_ / "tools/broken", executable);
  EXPECT_THAT(scriptBreaches(root_), ElementsAre("plain: begins with #! and may not be executed",
                                                 "tools/broken: bash -n refuses it"));
}

}  // namespace
}  // namespace overfly::house
