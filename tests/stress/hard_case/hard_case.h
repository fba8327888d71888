#pragma once
// The torture suite's table: every hard case is one line, what was measured against what must hold.
#include <string>

namespace overfly::test {

struct HardCase {
  std::string id;    // as docs/hard-cases.md names it: "place/elevation"
  std::string what;  // that was measured, with its unit
  double measured = 0;
  enum class Must { BeAtMost, BeAtLeast } must = Must::BeAtMost;
  double bound = 0;
};

// Prints the line, keeps it for the table that `tests/run stress` ends with
// (build/<preset>/hard-cases/), and fails the running test when the bound does not hold, or when
// docs/hard-cases.md does not explain the case.
void expectHolds(const HardCase& hard_case);

// A case that is known not to hold: its line says so, and the test fails when it does hold, so that the page
// is put right.
void expectKnownLimit(const HardCase& hard_case);

inline void expectAtMost(const std::string& id, const std::string& what, double measured, double bound) {
  expectHolds({id, what, measured, HardCase::Must::BeAtMost, bound});
}
inline void expectAtLeast(const std::string& id, const std::string& what, double measured, double bound) {
  expectHolds({id, what, measured, HardCase::Must::BeAtLeast, bound});
}

}  // namespace overfly::test
