#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "config/load.h"

namespace overfly::config {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

std::vector<std::string> problemsOf(std::string_view toml) {
  const auto loaded = loadText(toml, "f.toml");
  std::vector<std::string> texts;
  if (!loaded) {
    for (const Problem& problem : loaded.error()) texts.push_back(problem.text());
  }
  return texts;
}

class Folder : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (std::filesystem::temp_directory_path() / "overfly_config_XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    etc_ = name;
    std::filesystem::create_directory(etc_ / "conf.d");
  }
  void TearDown() override { std::filesystem::remove_all(etc_); }
  void write(const std::filesystem::path& name, std::string_view text) { std::ofstream(etc_ / name) << text; }
  // The sources of the folder without the environment of this process.
  [[nodiscard]] Sources sources() const {
    Sources found = installedSources(etc_);
    found.environment.clear();
    return found;
  }
  std::filesystem::path etc_;
};

TEST(Load, ReadsEveryKindOfValue) {
  const auto loaded = loadText(R"(
[source]
kind = "scene"
loop = true
start_frame = 7
speed = 2
[sweep]
cost = "ssd"
prefer = "latest"
[pose]
lever_arm_m = [1, 2.5, -3]
[link]
allowed_origins = ["https://a.example"]
tls_key = "/k"
tls_certificate = "/c"
)",
                               "f.toml");
  ASSERT_TRUE(loaded) << errorFrom(loaded.error()).message;
  const Settings& s = loaded->settings;
  EXPECT_EQ(s.source.kind, SourceKind::Scene);
  EXPECT_TRUE(s.source.loop);
  EXPECT_EQ(s.source.start_frame, 7);
  EXPECT_EQ(s.source.speed, 2.0);  // a whole number where a fraction is allowed
  EXPECT_EQ(s.sweep.cost, MatchingCost::Ssd);
  EXPECT_EQ(s.sweep.prefer, Prefer::Latest);
  EXPECT_THAT(s.pose.lever_arm_m, ElementsAre(1, 2.5, -3));
  EXPECT_THAT(s.link.allowed_origins, ElementsAre("https://a.example"));
  EXPECT_EQ(s.link.tls_key, "/k");
  EXPECT_EQ(loaded->origins.at("sweep.cost").line, 8);
}

TEST(Load, EveryErrorOfAFileIsToldAtOnceWithItsLine) {
  EXPECT_THAT(
      problemsOf("stray = 1\n[sweep]\nplanes = 3\nplane = 64\ncost = \"znc\"\n[swep]\nimages = 5\n"),
      ElementsAre(
          "f.toml:1: stray: stands outside of any [section]",
          "f.toml:3: sweep.planes: found 3, allowed a whole number from 8 to 1024",
          "f.toml:4: sweep.plane: no such key; did you mean sweep.planes?",
          "f.toml:5: sweep.cost: found \"znc\", allowed one of: sad, ssd, zncc, census; did you mean zncc?",
          "f.toml:6: [swep]: no such section; did you mean [sweep]?"));
}

TEST(Load, WrongTypesNameWhatWasFound) {
  EXPECT_THAT(
      problemsOf("[source]\nloop = 1\nstart_frame = 1.5\nspeed = \"fast\"\npath = 3\nkind = true\n"
                 "[pose]\nlever_arm_m = [1, 2]\nboresight_deg = [0, nan, 0]\n"
                 "[link]\nallowed_origins = [1]\nport = {a = 1}\nlisten = 2020-01-01\n"),
      ElementsAre("f.toml:2: source.loop: found 1, allowed true or false",
                  "f.toml:3: source.start_frame: found 1.5, allowed a whole number 0 or more",
                  "f.toml:4: source.speed: found \"fast\", allowed a number from 0 to 1000",
                  "f.toml:5: source.path: found 3, allowed text in quotes",
                  HasSubstr("f.toml:6: source.kind: found true, allowed one of: replay,"),
                  HasSubstr("f.toml:8: pose.lever_arm_m: found [1, 2], allowed a list of three numbers"),
                  HasSubstr("f.toml:9: pose.boresight_deg: found [0, nan, 0], allowed a list of three"),
                  HasSubstr("f.toml:11: link.allowed_origins: found [1], allowed a list of texts"),
                  "f.toml:12: link.port: found a table, allowed a whole number from 0 to 65535",
                  "f.toml:13: link.listen: found a date, allowed text in quotes"));
}

TEST(Load, RangesAreInclusiveAndTakeNeitherNanNorInfinity) {
  EXPECT_TRUE(loadText("[sweep]\nregularise = 1.0\nplanes = 1024", "f"));
  EXPECT_FALSE(loadText("[sweep]\nregularise = 1.0000001", "f"));
  EXPECT_FALSE(loadText("[sweep]\nregularise = nan", "f"));
  EXPECT_FALSE(loadText("[clipmap]\nmax_updates_per_s = inf", "f"));
  EXPECT_FALSE(loadText("[source]\nstart_frame = 9223372036854775807", "f"));
}

TEST(Load, AWrongUnitIsToldWithTheNumberToWrite) {
  EXPECT_THAT(
      problemsOf(
          "[pose]\nmax_gap_ms = \"0.2 s\"\nmax_gap_s = 0.2\ndelay_ms = \"3\"\n[map]\ngsd_m = \"5 cm\"\n"),
      ElementsAre("f.toml:2: pose.max_gap_ms: found \"0.2 s\", allowed a whole number from 1 to 60000 "
                  "(milliseconds); write the number alone: max_gap_ms = 200",
                  "f.toml:3: pose.max_gap_s: no such key; did you mean pose.max_gap_ms (in milliseconds)?",
                  HasSubstr("write it without quotes"), HasSubstr("write the number alone: gsd_m = 0.05")));
}

TEST(Load, AKeyOfAnotherSectionIsFound) {
  EXPECT_THAT(problemsOf("port = 80\n[log]\nram_mb = 3\nzzzzzzzz = 1\n"),
              ElementsAre("f.toml:1: port: stands outside of any [section]; did you mean link.port?",
                          "f.toml:3: log.ram_mb: no such key; did you mean clipmap.ram_mb (in MiB)?",
                          "f.toml:4: log.zzzzzzzz: no such key; [log] has: level"));
}

TEST(Load, SyntaxErrorsDoNotHideWhatStandsBelowThem) {
  EXPECT_THAT(
      problemsOf("[link]\nlisten = 127.0.0.1\nport = 8o\n[lnk\nport = 80\n[sweep]\nplanes = 3\n"),
      ElementsAre(
          HasSubstr("f.toml:2: link.listen: not TOML: found 127.0.0.1, allowed text in quotes"),
          HasSubstr("f.toml:3: link.port: not TOML: found 8o, allowed a whole number from 0 to 65535"),
          HasSubstr("f.toml:4: not TOML: found [lnk, allowed [section]"),
          "f.toml:7: sweep.planes: found 3, allowed a whole number from 8 to 1024"));
}

// toml++ 3.3 asserts on a header that begins with no name; found by fuzz_settings.
TEST(Load, AHeaderThatBeginsWithNoNameIsASyntaxError) {
  for (const char* header : {"[=", "[.a]", "[[ =]]", "[", "[ü]", "[\x01]"}) {
    EXPECT_THAT(problemsOf(std::string(header) + "\nx = 1\n[sweep]\nplanes = 3\n"),
                ElementsAre(HasSubstr("f.toml:1: not TOML"), HasSubstr("f.toml:4: sweep.planes")))
        << header;
  }
}

TEST(Load, AKeyGivenTwiceIsAnError) {
  EXPECT_THAT(problemsOf("[sweep]\nplanes = 32\nplanes = 64\n"),
              ElementsAre(HasSubstr("f.toml:3: sweep.planes: not TOML")));
}

TEST(Load, ASectionThatIsNoTableIsAnError) {
  EXPECT_THAT(problemsOf("sweep = 3\n[[store]]\nx = 1\n"),
              ElementsAre("f.toml:1: [sweep]: found 3, allowed a section [sweep]",
                          "f.toml:2: [store]: found a list of tables, allowed one section [store]"));
}

TEST(Load, TextsMustMatchTheirPattern) {
  for (const char* good : {"webmercator", "utm", "utm:33N", "utm:60S", "ups:N", "local", "local:-47.1,8"}) {
    EXPECT_TRUE(loadText("[map]\nlattice = \"" + std::string(good) + "\"", "f")) << good;
  }
  for (const char* bad : {"", "mercator", "utm:61N", "utm:0N", "utm:33", "local:1", "webmercator "}) {
    EXPECT_FALSE(loadText("[map]\nlattice = \"" + std::string(bad) + "\"", "f")) << bad;
  }
  for (const char* good :
       {"", "udp:14550", "udp:0.0.0.0:14550", "tcp:host:5760", "serial:/dev/ttyS1:921600"}) {
    EXPECT_TRUE(loadText("[pose]\nmavlink = \"" + std::string(good) + "\"", "f")) << good;
  }
  EXPECT_FALSE(loadText("[pose]\nmavlink = \"14550\"", "f"));
  EXPECT_FALSE(loadText("[pose]\nmavlink = \"tcp:" + std::string(100000, 'a') + ":1\"", "f"));
}

TEST(Load, KeysThatContradictEachOtherAreTold) {
  EXPECT_THAT(problemsOf("[link]\n\ntls_key = \"/k\"\n"),
              ElementsAre(HasSubstr("f.toml:3: link.tls_certificate: ")));
  EXPECT_THAT(problemsOf("[sweep]\nprefer = \"max_age\"\n"),
              ElementsAre(HasSubstr("f.toml:2: sweep.max_age_s: ")));
  EXPECT_THAT(problemsOf("[sweep]\nmin_parallax_deg = 50\n"),
              ElementsAre(HasSubstr("f.toml:2: sweep.min_parallax_deg")));
}

TEST_F(Folder, LaterFilesWinInTheOrderOfTheirNames) {
  write("overfly.toml", "[sweep]\nplanes = 16\nimages = 3\nlevels = 2\n");
  write("conf.d/20-b.toml", "[sweep]\nplanes = 48\n");
  write("conf.d/10-a.toml", "[sweep]\nplanes = 32\nimages = 4\n");
  write("conf.d/.hidden.toml", "[sweep]\nplanes = 1\n");
  write("conf.d/30-c.toml.bak", "[sweep]\nplanes = 2\n");
  const auto loaded = load(sources());
  ASSERT_TRUE(loaded) << errorFrom(loaded.error()).message;
  EXPECT_EQ(loaded->settings.sweep.planes, 48);
  EXPECT_EQ(loaded->settings.sweep.images, 4);
  EXPECT_EQ(loaded->settings.sweep.levels, 2);
  EXPECT_EQ(loaded->origins.at("sweep.planes").source, (etc_ / "conf.d/20-b.toml").string());
}

TEST_F(Folder, EnvironmentBeatsFilesAndSetBeatsBoth) {
  write("overfly.toml", "[sweep]\nplanes = 16\nimages = 3\nlevels = 2\n");
  Sources all = sources();
  all.environment = {{"OVERFLY_SWEEP_PLANES", "32"},
                     {"OVERFLY_SWEEP_IMAGES", "4"},
                     {"OVERFLY_POSE_LEVER_ARM_M", "1, 2,3.5"},
                     {"OVERFLY_SWEEP_BETTER_HALF", "false"},
                     {"OVERFLY_LINK_ALLOWED_ORIGINS", "[\"a\", \"b\"]"}};
  all.overrides = {"sweep.planes=48", "source.path=a=b", "sweep.planes=64"};
  const auto loaded = load(all);
  ASSERT_TRUE(loaded) << errorFrom(loaded.error()).message;
  EXPECT_EQ(loaded->settings.sweep.planes, 64);
  EXPECT_EQ(loaded->settings.sweep.images, 4);
  EXPECT_EQ(loaded->settings.sweep.levels, 2);
  EXPECT_FALSE(loaded->settings.sweep.better_half);
  EXPECT_EQ(loaded->settings.source.path, "a=b");
  EXPECT_THAT(loaded->settings.pose.lever_arm_m, ElementsAre(1, 2, 3.5));
  EXPECT_THAT(loaded->settings.link.allowed_origins, ElementsAre("a", "b"));
}

TEST(Load, EnvironmentAndSetAreCheckedLikeFiles) {
  Sources all;
  all.environment = {{"OVERFLY_SWEEP_PLANE", "32"},
                     {"OVERFLY_SWEEP_PLANES", "many"},
                     {"OVERFLY_BINARY_DIR", "/build"},  // not a section: somebody else's
                     {"PATH", "/bin"}};
  all.overrides = {"sweep.planes=1.5", "swep.planes=3", "planes=3", "sweep.planes", "sweep.cost=best"};
  const auto loaded = load(all);
  ASSERT_FALSE(loaded);
  std::vector<std::string> texts;
  for (const Problem& problem : loaded.error()) texts.push_back(problem.text());
  EXPECT_THAT(
      texts,
      ElementsAre(
          HasSubstr("environment OVERFLY_SWEEP_PLANE: sweep.plane: no such key; did you mean sweep.planes"),
          HasSubstr("environment OVERFLY_SWEEP_PLANES: sweep.planes: found \"many\""),
          HasSubstr("--set sweep.planes=1.5: sweep.planes: found \"1.5\""), HasSubstr("did you mean [sweep]"),
          HasSubstr("allowed is section.key=value"), HasSubstr("allowed is section.key=value"),
          HasSubstr("found \"best\", allowed one of")));
}

TEST_F(Folder, ProblemsOfAllFilesAreTold) {
  write("overfly.toml", "[sweep]\n\n\nplanes = 1\n");
  write("conf.d/a.toml", "[sweep]\nplanes = 2\n");
  const auto loaded = load(sources());
  ASSERT_FALSE(loaded);
  ASSERT_EQ(loaded.error().size(), 2U);
  EXPECT_THAT(loaded.error()[0].text(), HasSubstr("overfly.toml:4: "));
  EXPECT_THAT(loaded.error()[1].text(), HasSubstr("a.toml:2: "));
  EXPECT_EQ(errorFrom(loaded.error()).code, ErrorCode::BadSettings);
}

TEST_F(Folder, NoFilesAtAllGiveTheDefaults) {
  std::filesystem::remove_all(etc_ / "conf.d");
  const auto loaded = load(sources());
  ASSERT_TRUE(loaded);
  EXPECT_TRUE(loaded->origins.empty());
}

TEST_F(Folder, ANamedFileMustExistAndStandsAlone) {
  write("overfly.toml", "[sweep]\nplanes = 16\n");
  write("mine.toml", "[sweep]\nimages = 3\n");
  EXPECT_EQ(installedSources(etc_, etc_ / "mine.toml").files, std::vector{etc_ / "mine.toml"});
  EXPECT_FALSE(load(installedSources(etc_, etc_ / "absent.toml")));
  EXPECT_FALSE(load(installedSources(etc_, etc_ / "conf.d")));
}

TEST_F(Folder, AHugeFileIsRefusedUnread) {
  write("overfly.toml", "");
  std::filesystem::resize_file(etc_ / "overfly.toml", std::uintmax_t{1} << 40);
  const auto loaded = load(sources());
  ASSERT_FALSE(loaded);
  EXPECT_THAT(loaded.error()[0].text(), HasSubstr("found 1099511627776 bytes"));
}

}  // namespace
}  // namespace overfly::config
