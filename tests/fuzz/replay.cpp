// Runs a fuzz target over its corpus and a fixed number of mutations of it, with any compiler and without
// libFuzzer: what CI runs. The seed is fixed, so that a failure comes again.
//   replay CORPUS MUTATIONS
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace {

using Random = std::mt19937;

std::size_t pick(Random& random, std::size_t n) { return n == 0 ? 0 : random() % n; }

std::string mutated(std::string text, const std::vector<std::string>& corpus, Random& random) {
  const auto other = corpus[pick(random, corpus.size())];
  for (auto rounds = 1 + pick(random, 4); rounds > 0; --rounds) {
    const auto at = pick(random, text.size() + 1), length = pick(random, 12);
    switch (random() % 6) {
      case 0:  // a byte
        if (at < text.size()) text[at] = static_cast<char>(random());
        break;
      case 1:  // a bit
        if (at < text.size()) text[at] = static_cast<char>(text[at] ^ (1 << (random() % 8)));
        break;
      case 2:
        text.erase(at, length);
        break;
      case 3: {  // a piece of another one
        const auto from = pick(random, other.size() + 1);
        text.insert(at, other, from, 3 * length);
        break;
      }
      case 4: {  // numbers at the edges
        static constexpr const char* kNumbers[] = {
            "0",     "-1",  "18446744073709551615", "9223372036854775807", "2147483648",
            "1e999", "nan", "00000000000000000001"};
        text.insert(at, kNumbers[random() % std::size(kNumbers)]);
        break;
      }
      default:  // again
        text.insert(at, text, at, length);
    }
  }
  return text;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  std::vector<std::string> corpus;
  for (const auto& entry : std::filesystem::directory_iterator(argv[1])) {
    std::ifstream in(entry.path(), std::ios::binary);
    corpus.emplace_back(std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>());
  }
  std::sort(corpus.begin(), corpus.end());
  if (corpus.empty()) return 2;
  const auto feed = [](const std::string& text) {
    (void)LLVMFuzzerTestOneInput(reinterpret_cast<const std::uint8_t*>(text.data()), text.size());
  };
  for (const auto& text : corpus) feed(text);
  constexpr unsigned kSeed = 20250718;
  Random random(kSeed);
  const auto runs = std::strtol(argv[2], nullptr, 10);
  for (long i = 0; i < runs; ++i) feed(mutated(corpus[pick(random, corpus.size())], corpus, random));
  std::printf("%zu inputs and %ld mutations, seed %u\n", corpus.size(), runs, kSeed);
  return 0;
}
