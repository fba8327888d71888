// Damaged flight folders: a clear error or skipped frames, never a crash. The seed of a failing folder is
// printed; OVERFLY_CORRUPTED_FLIGHTS sets how many are made of each kind (2,000 folders in all by default).
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <iterator>

#include "capture/import/survey.h"
#include "capture/record/files.h"
#include "capture/replay/replay_source.h"
#include "tests/integration/flight/made_frames.h"

namespace overfly::capture {
namespace {

using namespace testing_data;

unsigned folders() {
  const char* text = std::getenv("OVERFLY_CORRUPTED_FLIGHTS");
  return text ? static_cast<unsigned>(std::atoi(text)) : 1000;
}

std::string contentOf(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

void write(const std::filesystem::path& file, const std::string& content) {
  std::ofstream(file, std::ios::binary) << content;
}

constexpr int kFrames = 6;

void makeOwnFlight(const std::filesystem::path& folder) {
  FlightInfo info;
  info.ground_height_m = 440;
  auto recorder = FlightRecorder::create(folder, info).value();
  for (std::uint64_t i = 0; i < kFrames; ++i) {
    ASSERT_TRUE(recorder.record(madeFrame(i)));
    ASSERT_TRUE(recorder.record(ClockPair{static_cast<std::int64_t>(i), DeviceClock::Camera, 1, 2, 3}));
  }
}

void makeCsvFlight(const std::filesystem::path& folder) {
  std::filesystem::create_directories(folder / "images");
  write(folder / "camera.json",
        R"json({"model": "OPENCV", "width": 64, "height": 48, "fx": 58.1, "fy": 58.1, "cx": 31.5, "cy": 23.5,
 "k1": -0.01, "k2": 0.01, "p1": 0.0006, "p2": 0.0007, "pixel_convention": "OpenCV: centre (0,0)",
 "enu_origin": {"lat": 46.8, "lon": -91.9, "alt": 158.0, "alt_kind": "EXIF"}})json");
  std::string csv =
      "filename,timestamp_ns,lat,lon,alt,x,y,z,qw,qx,qy,qz,raw_lat,raw_lon,raw_alt,raw_rel_alt,"
      "raw_gimbal_yaw_deg,raw_gimbal_pitch_deg,raw_gimbal_roll_deg\n";
  const geo::LocalFrame local({geo::radians(46.8), geo::radians(-91.9), 158});
  for (int i = 0; i < kFrames; ++i) {
    const Eigen::Vector3d enu(10.0 * i, 3.0 * i, 40.0);
    const geo::Geodetic place = geo::geodeticFromEcef(local.ecefFromEnu(enu));
    csv += fmt::format(
        "{:08}.jpg,{},{:.9f},{:.9f},{:.4f},{},{},{},0.0059,-0.9290106,0.369964,0.00557,{:.9f},{:.9f},"
        "198.3,39.8,45.0,-89.9,0.0\n",
        i, 1466717519000000000 + i * 7000000000, geo::degrees(place.lat), geo::degrees(place.lon),
        place.height_m, enu.x(), enu.y(), enu.z(), geo::degrees(place.lat), geo::degrees(place.lon));
    const auto bytes = madeFrame(static_cast<std::uint64_t>(i)).image.bytes;
    write(folder / "images" / fmt::format("{:08}.jpg", i), std::string(bytes.begin(), bytes.end()));
  }
  write(folder / "flight.csv", csv);
  write(folder / "reference_points.csv",
        "x,y,z\n1,2,1.8\n2,3,1.7\n3,4,1.9\n1,2,1.8\n2,3,1.7\n3,4,1.9\n1,2,1.8\n2,3,1.7\n"
        "3,4,1.9\n5,6,1.8\n");
}

// Where the words and numbers of a text stand.
std::vector<std::pair<std::size_t, std::size_t>> wordsOf(const std::string& text) {
  std::vector<std::pair<std::size_t, std::size_t>> words;
  for (std::size_t i = 0; i < text.size();) {
    const std::size_t end = text.find_first_of(",:[]{}\n \"", i);
    const std::size_t stop = end == std::string::npos ? text.size() : end;
    if (stop > i) words.emplace_back(i, stop - i);
    i = stop + 1;
  }
  return words;
}

class Mutator {
 public:
  Mutator(std::filesystem::path folder, unsigned seed) : folder_(std::move(folder)), random_(seed) {
    for (const auto& entry : std::filesystem::recursive_directory_iterator(folder_)) {
      if (!entry.is_regular_file()) continue;
      (entry.path().parent_path().filename() == "images" ? images_ : texts_).push_back(entry.path());
    }
    std::sort(images_.begin(), images_.end());
    std::sort(texts_.begin(), texts_.end());
  }

  void damage() {
    const auto times = 1 + random_() % 3;
    for (unsigned long i = 0; i < times; ++i) once();
  }

 private:
  std::filesystem::path& one(std::vector<std::filesystem::path>& files) {
    return files[random_() % files.size()];
  }

  // Not one that an earlier change made a folder, absent or absurdly large.
  static bool isSmall(const std::filesystem::path& file) {
    return std::filesystem::is_regular_file(file) && std::filesystem::file_size(file) < 1'000'000;
  }

  void once() {
    const auto file = random_() % 4 == 0 ? one(images_) : one(texts_);
    if (!isSmall(file)) return;
    std::string content = contentOf(file);
    switch (random_() % 11) {
      case 0:  // cut
        content.resize(content.empty() ? 0 : random_() % content.size());
        break;
      case 1:  // changed bytes
        for (int i = 0; i < 8 && !content.empty(); ++i)
          content[random_() % content.size()] = static_cast<char>(random_());
        break;
      case 2: {  // absurd word
        static const char* kWords[] = {"nan",
                                       "NaN",
                                       "inf",
                                       "-1",
                                       "0",
                                       "1e308",
                                       "-1e308",
                                       "1e-320",
                                       "999999999999999999999",
                                       "2147483648",
                                       "-9223372036854775808",
                                       "9223372036854775807",
                                       "",
                                       "null",
                                       "true",
                                       "x",
                                       "[[[[",
                                       "\"",
                                       "../../../etc/passwd",
                                       "4294967295",
                                       "1e5",
                                       "65501"};
        const auto words = wordsOf(content);
        if (words.empty()) break;
        const auto [at, length] = words[random_() % words.size()];
        content.replace(at, length, kWords[random_() % std::size(kWords)]);
        repairChecksums(file, content);
        break;
      }
      case 3: {  // a word out of another place
        const auto words = wordsOf(content);
        if (words.empty()) break;
        const auto [at, length] = words[random_() % words.size()];
        const auto [from, count] = words[random_() % words.size()];
        content.replace(at, length, content.substr(from, count));
        repairChecksums(file, content);
        break;
      }
      case 4: {  // a line gone or twice
        const std::size_t start = content.find('\n', content.empty() ? 0 : random_() % content.size());
        if (start == std::string::npos) break;
        const std::size_t end = content.find('\n', start + 1);
        const std::string line = content.substr(start, end == std::string::npos ? end : end - start);
        random_() % 2 == 0 ? content.erase(start, line.size()) : content.insert(start, line);
        break;
      }
      case 5: {  // a column gone
        std::string out;
        const std::size_t gone = random_() % 12;
        std::size_t column = 0;
        for (const char c : content) {
          if (c == ',') ++column;
          if (c == '\n') column = 0;
          if (column != gone || c == '\n') out += c;
        }
        content = out;
        break;
      }
      case 6: {  // swapped images
        auto &a = one(images_), &b = one(images_);
        if (a == b || !isSmall(a) || !isSmall(b)) return;
        const std::string other = contentOf(b);
        write(b, contentOf(a));
        write(a, other);
        return;
      }
      case 7:  // an image of another size, or none
        if (random_() % 2 == 0) {
          std::filesystem::remove(one(images_));
        } else {
          const auto bytes = madeFrame(99, PixelFormat::Jpeg, 32, 24).image.bytes;
          write(one(images_), std::string(bytes.begin(), bytes.end()));
        }
        return;
      case 8:                                                                           // absurd size
        std::filesystem::resize_file(file, std::uintmax_t{1} << (30 + random_() % 8));  // sparse
        return;
      case 9:  // a folder in a file's place
        std::filesystem::remove(file);
        std::filesystem::create_directory(file);
        return;
      case 10:  // gone
        std::filesystem::remove(file);
        return;
    }
    write(file, content);
  }

  // Half of the wrong words in our own table come with a right checksum, so that the values are looked at.
  void repairChecksums(const std::filesystem::path& file, std::string& content) {
    if (file.filename() != "frames.tbl" || random_() % 2 == 0) return;
    std::string out;
    for (std::size_t i = 0; i < content.size();) {
      const std::size_t end = std::min(content.find('\n', i), content.size());
      const std::size_t space = std::min(content.find(' ', i), end);
      const std::string text = space < end ? content.substr(space + 1, end - space - 1) : "";
      out += fmt::format("{:08x} {}\n", crc32Of(bytesOf(text)), text);
      i = end + 1;
    }
    content = out;
  }

  std::filesystem::path folder_;
  std::mt19937 random_;
  std::vector<std::filesystem::path> images_, texts_;
};

struct Tally {
  unsigned refused = 0, partly = 0, whole = 0;
};

void readEverything(const std::filesystem::path& folder, const ImportOptions& import, Tally& tally) {
  const auto flight = importFlight(folder, import);
  (void)readRawLog(folder);
  if (!flight) {
    EXPECT_GT(flight.error().message.size(), 15u);
    EXPECT_NE(flight.error().code, ErrorCode::Internal);
    ++tally.refused;
    return;
  }
  ASSERT_LE(flight->size(), static_cast<std::size_t>(2 * kFrames));
  (void)surveyFlight(*flight);
  ReplayOptions options;
  options.speed = 0;
  ReplaySource source(std::make_shared<const Flight>(*flight), options);
  ASSERT_TRUE(source.open());
  std::size_t good = 0;
  std::int64_t time = std::numeric_limits<std::int64_t>::min();
  for (std::size_t i = 0; i <= flight->size(); ++i) {
    const auto frame = source.next(std::chrono::seconds(1));
    if (!frame) {
      EXPECT_EQ(frame.error().code, ErrorCode::BadInput);
      EXPECT_NE(frame.error().message.find('/'), std::string::npos)
          << "names no file: " << frame.error().message;
      continue;
    }
    if (!*frame) break;
    EXPECT_GT((*frame)->time_ns, time);
    time = (*frame)->time_ns;
    EXPECT_EQ((*frame)->camera.problem(), std::nullopt);
    if ((*frame)->pose) {
      EXPECT_TRUE((*frame)->pose->position_in_ecef.allFinite());
      EXPECT_NEAR((*frame)->pose->ecef_from_camera.norm(), 1, 1e-9);
    }
    (void)decodeImage((*frame)->image, PixelFormat::Grey8, 8);
    ++good;
  }
  ++(good == kFrames ? tally.whole : tally.partly);
}

void attack(void (*make)(const std::filesystem::path&), unsigned first_seed, bool raw_too) {
  const TemporaryFolder folder(true);
  make(folder / "good");
  Tally tally;
  for (unsigned seed = first_seed; seed < first_seed + folders(); ++seed) {
    SCOPED_TRACE(fmt::format("seed {}", seed));
    std::filesystem::copy(folder / "good", folder / "bad", std::filesystem::copy_options::recursive);
    Mutator(folder / "bad", seed).damage();
    ImportOptions options;
    options.raw = raw_too && seed % 2 == 1;
    readEverything(folder / "bad", options, tally);
    std::filesystem::remove_all(folder / "bad");
    if (testing::Test::HasFailure()) break;
  }
  std::printf("%u refused, %u partly read, %u whole\n", tally.refused, tally.partly, tally.whole);
  EXPECT_GT(tally.refused, folders() / 20);
  EXPECT_GT(tally.partly, folders() / 20);
}

TEST(CorruptedFlights, OfOurOwnFormatAreRefusedOrPartlyRead) { attack(makeOwnFlight, 0, false); }

TEST(CorruptedFlights, OfFlightCsvFoldersAreRefusedOrPartlyRead) { attack(makeCsvFlight, 1'000'000, true); }

}  // namespace
}  // namespace overfly::capture
