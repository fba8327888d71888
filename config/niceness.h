#pragma once
#include <sys/resource.h>
#include <unistd.h>

namespace overfly {

// How far threads stand back when the processors do not suffice for all: cameras, autopilot, pulses and the
// link first (0), then mapping, then what only prepares pictures that nobody waits for.
inline constexpr int kMappingNiceness = 5;
inline constexpr int kPreparingNiceness = 15;

// The calling thread, and those that it starts later: on Linux niceness is a thread's own. Nothing happens
// where it is not permitted.
inline void standBack(int niceness) {
  (void)setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), niceness);
}

}  // namespace overfly
