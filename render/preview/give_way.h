#pragma once
#include <sys/resource.h>
#include <unistd.h>

namespace overfly::preview {

// The calling thread gives way to those that draw and map: on Linux niceness is a thread's own. Threads that
// prepare tiles are never what a picture waits for.
inline void giveWay() {
  constexpr int kNiceness = 10;
  (void)setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), kNiceness);
}

}  // namespace overfly::preview
