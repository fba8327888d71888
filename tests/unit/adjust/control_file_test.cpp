#include "tiling/adjust/control_file.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

namespace overfly::tiling::adjust {
namespace {

class ControlFile : public testing::Test {
 protected:
  std::filesystem::path write(const std::string& text) {
    const auto path = std::filesystem::path(testing::TempDir()) /
                      testing::UnitTest::GetInstance()->current_test_info()->name();
    std::ofstream(path) << text;
    return path;
  }
};

TEST_F(ControlFile, ReadsGcpListInLongitudeLatitude) {
  const auto read =
      readControlFile(write("EPSG:4326\n-91.99 46.84 160.5 100.5 200 a.jpg gcp01\n"
                            "-91.99 46.84 160.5 300 400 b.jpg gcp01\n"));
  ASSERT_TRUE(read) << read.error().message;
  ASSERT_EQ(read->size(), 1U);
  EXPECT_NEAR(geo::degrees((*read)[0].place.lat), 46.84, 1e-12);
  EXPECT_DOUBLE_EQ((*read)[0].place.height_m, 160.5);
  ASSERT_EQ((*read)[0].marks.size(), 2U);
  EXPECT_EQ((*read)[0].marks[1].image, "b.jpg");
  EXPECT_DOUBLE_EQ((*read)[0].marks[0].pixel.x(), 100.5);
}

TEST_F(ControlFile, ReadsGcpListInUtm) {
  // Zone 15 north: the central meridian is 93 degrees west, where easting is 500 km;
  // the arc from the equator to 45 degrees is 4984944.378 m, times 0.9996.
  const auto read = readControlFile(write("WGS84 UTM 15N\n500000 4982950.4002 10 1 2 a.jpg\n"));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_NEAR(geo::degrees((*read)[0].place.lon), -93, 1e-9);
  EXPECT_NEAR(geo::degrees((*read)[0].place.lat), 45, 1e-8);
}

TEST_F(ControlFile, ReadsCsvWithCheckPoints) {
  const auto read =
      readControlFile(write("name,lat,lon,height,image,px,py,sigma,check\nA,46,-91,100,a.jpg,1,2,0.02,0\nB,"
                            "46.1,-91,101,a.jpg,3,4,,1\n"));
  ASSERT_TRUE(read) << read.error().message;
  ASSERT_EQ(read->size(), 2U);
  EXPECT_DOUBLE_EQ((*read)[0].sigma_m.x(), 0.02);
  EXPECT_FALSE((*read)[0].check);
  EXPECT_TRUE((*read)[1].check);
}

TEST_F(ControlFile, SaysWhichLineIsWrong) {
  const auto read = readControlFile(write("EPSG:4326\n1 2 3 4 5 a.jpg\n1 2 x 4 5 a.jpg\n"));
  ASSERT_FALSE(read);
  EXPECT_NE(read.error().message.find("line 3"), std::string::npos) << read.error().message;
}

TEST_F(ControlFile, RefusesOtherProjections) {
  const auto read = readControlFile(write("EPSG:2056\n2600000 1200000 500 1 2 a.jpg\n"));
  ASSERT_FALSE(read);
  EXPECT_EQ(read.error().code, ErrorCode::Unsupported);
}

}  // namespace
}  // namespace overfly::tiling::adjust
