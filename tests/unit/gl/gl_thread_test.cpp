#include "render/gl/gl_thread.h"

#include <gtest/gtest.h>

#include <deque>
#include <vector>

#include "render/gl/buffer.h"

namespace overfly::gl {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

std::unique_ptr<GlThread> started() {
  auto made = GlThread::start();
  if (!made) throw std::runtime_error(made.error().message);
  return std::move(*made);
}

TEST(GlThread, JobsReturnValuesErrorsAndExceptions) {
  auto thread = started();
  auto value = thread->submit(Priority::Mapping, "value", [](Context& context) -> Result<int> {
    return context.info().limits.texture_size;
  });
  auto error = thread->submit(Priority::Mapping, "error",
                              [](Context&) -> Result<void> { return fail(ErrorCode::BadInput, "no"); });
  auto thrown = thread->submit(Priority::Mapping, "throw",
                               [](Context&) -> Result<void> { throw std::logic_error("bug"); });
  EXPECT_GT(value.get().value(), 0);
  EXPECT_EQ(error.get().error().code, ErrorCode::BadInput);
  EXPECT_THROW(static_cast<void>(thrown.get()), std::logic_error);
}

TEST(GlThread, PreviewRunsBetweenTheSlicesOfALongJob) {
  auto thread = started();
  std::atomic<bool> preview_done{false};
  std::atomic<int> slices{0};
  auto long_job =
      thread->submitSliced(Priority::Mapping, "long", [&](Context&, const SliceClock& clock) -> Result<bool> {
        ++slices;
        while (!clock.over() && !preview_done) std::this_thread::sleep_for(milliseconds(1));
        return preview_done.load();
      });
  while (slices == 0) std::this_thread::sleep_for(milliseconds(1));
  auto preview = thread->submit(Priority::Preview, "preview", [&](Context&) -> Result<void> {
    preview_done = true;
    return {};
  });
  // The long job ends only after the preview has run: without slices this would wait for ever.
  ASSERT_EQ(preview.wait_for(std::chrono::seconds(10)), std::future_status::ready);
  ASSERT_TRUE(long_job.get().has_value());
  EXPECT_GE(slices.load(), 2);
}

TEST(GlThread, AJobInOneCallGivesWayToPreviews) {
  auto thread = started();
  std::atomic<int> previews{0};
  std::atomic<bool> begun{false};
  auto mapping = thread->submit(Priority::Mapping, "sweep", [&](Context&) -> Result<int> {
    begun = true;
    const auto end = steady_clock::now() + std::chrono::seconds(20);
    while (previews < 3 && steady_clock::now() < end) thread->giveWay();
    return previews.load();
  });
  while (!begun) std::this_thread::sleep_for(milliseconds(1));
  std::vector<std::future<Result<void>>> done;
  for (int i = 0; i < 3; ++i)
    done.push_back(thread->submit(Priority::Preview, "preview", [&](Context& context) -> Result<void> {
      ++previews;
      return context.check();
    }));
  EXPECT_EQ(mapping.get().value(), 3);
  for (auto& one : done) EXPECT_TRUE(one.get().has_value());
}

// Both always have work: previews get their share of the time and no more.
TEST(GlThread, PreviewsKeepToTheirShareWhileMappingHasWork) {
  for (const double share : {0.0, 0.25}) {
    auto thread = started();
    thread->setPreviewShare(share);
    std::atomic<bool> stop{false};
    auto mapping = thread->submit(Priority::Mapping, "sweep", [&](Context&) -> Result<void> {
      while (!stop) {
        std::this_thread::sleep_for(milliseconds(5));
        thread->giveWay();
      }
      return {};
    });
    const auto preview = [](Context&) -> Result<void> {
      std::this_thread::sleep_for(milliseconds(20));
      return {};
    };
    std::deque<std::future<Result<void>>> waiting;
    while (thread->stats().busy[1] < std::chrono::seconds(2)) {
      while (waiting.size() < 3) waiting.push_back(thread->submit(Priority::Preview, "preview", preview));
      if (waiting.front().wait_for(milliseconds(20)) == std::future_status::ready) waiting.pop_front();
    }
    const auto busy = thread->stats().busy;
    stop = true;
    ASSERT_TRUE(mapping.get().has_value());
    const double taken =
        static_cast<double>(busy[0].count()) / static_cast<double>((busy[0] + busy[1]).count());
    EXPECT_LE(taken, share + 0.08);
    EXPECT_GE(taken, share - 0.08);
    for (auto& one : waiting) EXPECT_TRUE(one.get().has_value());  // served as soon as nothing else waits
  }
}

TEST(GlThread, HigherPriorityGoesFirstEqualsInOrder) {
  auto thread = started();
  std::promise<void> gate;
  auto opened = gate.get_future().share();
  std::vector<std::string> order;
  const auto note = [&order](std::string name) {
    return [&order, name](Context&) -> Result<void> {
      order.push_back(name);
      return {};
    };
  };
  std::vector<std::future<Result<void>>> all;
  all.push_back(thread->submit(Priority::Preview, "gate", [opened](Context&) -> Result<void> {
    opened.wait();
    return {};
  }));
  all.push_back(thread->submit(Priority::Background, "c", note("c")));
  all.push_back(thread->submit(Priority::Mapping, "b1", note("b1")));
  all.push_back(thread->submit(Priority::Mapping, "b2", note("b2")));
  all.push_back(thread->submit(Priority::Preview, "a", note("a")));
  gate.set_value();
  for (auto& one : all) ASSERT_TRUE(one.get().has_value());
  EXPECT_EQ(order, (std::vector<std::string>{"a", "b1", "b2", "c"}));
}

TEST(GlThread, ABusyPreviewDoesNotStarveTheMap) {
  auto thread = started();
  std::atomic<bool> mapped{false};
  auto preview =
      thread->submitSliced(Priority::Preview, "busy", [&](Context&, const SliceClock&) -> Result<bool> {
        std::this_thread::sleep_for(milliseconds(5));
        return mapped.load();
      });
  auto map = thread->submit(Priority::Background, "map", [&](Context&) -> Result<void> {
    mapped = true;
    return {};
  });
  ASSERT_EQ(map.wait_for(std::chrono::seconds(10)), std::future_status::ready);
  EXPECT_TRUE(preview.get().has_value());
}

TEST(GlThread, ALostContextFailsItsJobAndTheNextFindsANewOne) {
  auto thread = started();
  EXPECT_EQ(thread->generation(), 1u);
  auto held = std::make_shared<Buffer>();
  ASSERT_TRUE(thread
                  ->submit(Priority::Mapping, "make",
                           [held](Context& context) -> Result<void> {
                             auto made = Buffer::create(context, 64);
                             if (!made) return tl::unexpected(made.error());
                             *held = std::move(*made);
                             return {};
                           })
                  .get());
  auto lost = thread->submitSliced(Priority::Mapping, "lose",
                                   [](Context& context, const SliceClock&) -> Result<bool> {
                                     context.injectLoss();
                                     return false;
                                   });
  EXPECT_EQ(lost.get().error().code, ErrorCode::Unavailable);
  const auto again = thread
                         ->submit(Priority::Mapping, "rebuild",
                                  [held](Context& context) -> Result<std::size_t> {
                                    auto made = Buffer::create(context, 128);
                                    if (!made) return tl::unexpected(made.error());
                                    *held = std::move(*made);
                                    const std::size_t bytes = held->bytes();
                                    *held = Buffer();
                                    return bytes;
                                  })
                         .get();
  ASSERT_TRUE(again.has_value()) << again.error().message;
  EXPECT_EQ(*again, 128u);
  EXPECT_EQ(thread->generation(), 2u);
}

TEST(GlThread, EndingFailsWhatStillWaits) {
  std::future<Result<void>> never_ends, waiting;
  {
    auto thread = started();
    never_ends =
        thread->submitSliced(Priority::Preview, "for ever", [](Context&, const SliceClock&) -> Result<bool> {
          std::this_thread::sleep_for(milliseconds(2));
          return false;
        });
    waiting = thread->submit(Priority::Background, "waiting", [](Context&) -> Result<void> { return {}; });
  }
  EXPECT_EQ(never_ends.get().error().code, ErrorCode::Unavailable);
  EXPECT_EQ(waiting.get().error().code, ErrorCode::Unavailable);
}

TEST(GlThread, LongSlicesAreCounted) {
  auto thread = started();
  ASSERT_TRUE(thread
                  ->submit(Priority::Mapping, "slow",
                           [](Context&) -> Result<void> {
                             std::this_thread::sleep_for(milliseconds(120));
                             return {};
                           })
                  .get());
  // The statistics are written after the future is set.
  for (int i = 0; i < 1000 && thread->stats().slices == 0; ++i) std::this_thread::sleep_for(milliseconds(1));
  EXPECT_EQ(thread->stats().long_slices, 1u);
  EXPECT_EQ(thread->stats().longest_job, "slow");
}

}  // namespace
}  // namespace overfly::gl
