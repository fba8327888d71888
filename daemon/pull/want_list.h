#pragma once
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "daemon/link/bundle.h"

namespace overfly::pull {

// A layer of a tile of the drone's map.
struct LayerKey {
  geo::TileKey key;
  tiling::Layer layer = tiling::Layer::Color;
  friend auto operator<=>(const LayerKey&, const LayerKey&) = default;
};

// One line of /changes, or a tile named by an event.
struct Listed {
  LayerKey what;
  std::uint64_t revision = 0;  // at the drone
  std::uint32_t bytes = 0;     // encoded; 0: not known
};

// Which layers a mirror still wants, and in what order: what is looked at first, then what it never had,
// coarse before fine and colour before heights; what it has in an older revision takes a third of the bytes
// meanwhile, the longest unrefreshed first, so that a live map's overview, which every frame changes, neither
// goes stale nor starves the rest. Knows no network and no disk. Thread rule: one thread.
//
// The list of changes comes in pages; the cursor behind a page may be kept only when every layer of it and of
// the pages before it is in the mirror. cursor() says which one that is.
class WantList {
 public:
  // Of a page of /changes, without what the mirror has already; `cursor` is where the next page begins. With
  // `older` the mirror holds an earlier revision.
  void addPage(const std::string& cursor, const std::vector<Listed>& page);
  // Named by an event or by a look: wanted too, but no cursor waits for it.
  void add(const Listed& one);
  // The mirror holds this revision (committed or about to be).
  void have(const LayerKey& what, std::uint64_t revision);
  [[nodiscard]] std::uint64_t revisionOf(const LayerKey& what) const;  // 0: never had
  void clear();

  // Takes layers worth about `bytes` out of the line, one at least if there is any; they are in flight until
  // done() or giveBack().
  [[nodiscard]] std::vector<Listed> take(std::uint64_t bytes, std::size_t most);
  // Arrived in `revision`, which may be later than listed; or, with revision 0, is not there any more.
  void done(const LayerKey& what, std::uint64_t revision, std::uint64_t bytes);
  // Was not sent; wanted again.
  void giveBack(const LayerKey& what);

  // Tiles that somebody looks at on the ground side; their ancestors and descendants come first.
  void lookAt(const std::vector<geo::TileKey>& tiles);

  // The latest cursor that everything before is done for, once; nullopt when it did not advance.
  [[nodiscard]] std::optional<std::string> cursor();
  [[nodiscard]] bool pagesOpen() const { return !pages_.empty(); }

  [[nodiscard]] std::size_t waiting() const { return waiting_.size(); }
  [[nodiscard]] std::size_t inFlight() const { return in_flight_.size(); }
  [[nodiscard]] std::uint64_t waitingBytes() const { return waiting_bytes_; }
  [[nodiscard]] std::uint64_t wantedRevision() const;  // the oldest revision that is not here yet; 0: none

 private:
  struct Want {
    Listed listed;
    std::uint64_t page = 0;  // 0: of none
    bool stale = false;      // an older revision is here
    bool looked = false;
    bool again = false;  // came once in a revision before the listed one
  };
  struct Page {
    std::uint64_t number = 0;
    std::string cursor;
    std::size_t open = 0;
  };
  // Smaller comes first.
  struct Rank {
    std::uint64_t refreshed = 0;  // of stale ones: when it last came
    int zoom = 0;
    int layer = 0;
    std::uint64_t order = 0;
    friend auto operator<=>(const Rank&, const Rank&) = default;
  };
  using Line = std::set<std::pair<Rank, LayerKey>>;

  void enqueue(Want want);
  void dequeue(const LayerKey& what);
  void closePage(std::uint64_t number);
  [[nodiscard]] Rank rankOf(const Want& want) const;
  [[nodiscard]] Line& lineOf(const Want& want);
  [[nodiscard]] bool isLooked(const geo::TileKey& key) const;
  [[nodiscard]] std::uint64_t estimate(const Listed& listed) const;

  std::map<LayerKey, Want> waiting_;
  std::map<LayerKey, Rank> ranks_;  // of those that wait
  std::map<LayerKey, Want> in_flight_;
  Line looked_, fresh_, stale_;
  std::deque<Page> pages_;
  std::optional<std::string> ready_;
  std::map<LayerKey, std::uint64_t> revisions_;
  std::map<LayerKey, std::uint64_t> refreshed_;
  std::vector<geo::TileKey> looks_;
  std::map<tiling::Layer, std::uint64_t> mean_bytes_;
  std::uint64_t next_page_ = 1, clock_ = 0, waiting_bytes_ = 0;
  double fresh_credit_ = 0;  // bytes that the stale line is owed when negative
};

}  // namespace overfly::pull
