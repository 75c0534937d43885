#include "engine/ranks/deal_triangles.h"

#include <algorithm>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "engine/exchange/pack.h"
#include "engine/exchange/round_budget.h"

namespace locvol {
namespace {

constexpr std::uint64_t kSample = std::uint64_t{1} << 16;

// Of a sample of about kSample triangles of all ranks, the smallest corners; ascending.
std::vector<MortonKey> sampled_places(const RawSurface& part, std::uint64_t first_id,
                                      std::uint64_t num_triangles, const Frame& frame,
                                      Exchange& exchange) {
  const std::uint64_t step = num_triangles / kSample + 1;
  std::vector<MortonKey> places;
  for (const TriangleList& list : part.triangles)
    part.spill.for_each(list, [&](const Triangle& t) {
      if ((first_id + t.id) % step == 0)
        places.push_back(frame.key_of(std::ranges::min(t.corners)));
    });
  places = gather_all(exchange, places);
  std::ranges::sort(places);
  return places;
}

class Dealer {
 public:
  Dealer(TriangleSpill& spill, std::uint64_t first_id, std::span<const SheetId> groups,
         const Frame& frame, const Shares& shares, Exchange& exchange)
      : first_id_(first_id),
        groups_(groups),
        frame_(frame),
        shares_(shares),
        exchange_(exchange),
        messages_(static_cast<std::size_t>(exchange.num_ranks())),
        budget_(exchange.num_ranks()),
        lists_(messages_.size()) {
    for (TriangleList& list : lists_) writers_.emplace_back(spill, list);
  }

  void begin_round() { budget_.begin_round(); }
  bool has_room() const { return budget_.has_room(); }

  // To all whose share it may meet.
  void send(Triangle triangle) {
    triangle.id += first_id_;
    triangle.sheet = groups_[triangle.sheet - 1];
    const Box reach = triangle.box().expanded(frame_.unit());  // cells are closed
    const int first = shares_.owner_of(frame_.key_of(reach.min));
    if (first == shares_.owner_of(frame_.key_of(reach.max))) return send_to(first, triangle);
    for (const int rank : shares_.ranks_within(frame_, reach, 0)) send_to(rank, triangle);
  }

  void end_round() {
    const std::size_t num_ranks = messages_.size();
    const auto received =
        exchange_.swap(std::exchange(messages_, std::vector<std::string>(num_ranks)));
    for (std::size_t rank = 0; rank < num_ranks; ++rank) take(writers_[rank], received[rank]);
  }

  // All that came, by rank.
  std::vector<TriangleList> lists() && {
    for (TriangleWriter& writer : writers_) writer.flush();
    std::erase_if(lists_, [](const TriangleList& list) { return list.count == 0; });
    return std::move(lists_);
  }

 private:
  void send_to(int rank, const Triangle& triangle) {
    const auto r = static_cast<std::size_t>(rank);
    if (rank == exchange_.rank()) return writers_[r].append(triangle);
    messages_[r].append(reinterpret_cast<const char*>(&triangle), sizeof triangle);
    budget_.add(rank, sizeof triangle);
  }

  static void take(TriangleWriter& writer, const std::string& message) {
    if (message.size() % sizeof(Triangle) != 0)
      throw ExchangeError("triangles from another rank did not arrive whole");
    for (std::size_t place = 0; place < message.size(); place += sizeof(Triangle)) {
      Triangle triangle;
      std::memcpy(&triangle, message.data() + place, sizeof triangle);
      writer.append(triangle);
    }
  }

  std::uint64_t first_id_;
  std::span<const SheetId> groups_;
  const Frame& frame_;
  const Shares& shares_;
  Exchange& exchange_;
  std::vector<std::string> messages_;
  RoundBudget budget_;
  std::vector<TriangleList> lists_;
  std::vector<TriangleWriter> writers_;
};

}  // namespace

Shares shares_of_triangles(const RawSurface& part, std::uint64_t first_id,
                           std::uint64_t num_triangles, const Frame& frame, int level,
                           Exchange& exchange) {
  const std::vector<MortonKey> places =
      sampled_places(part, first_id, num_triangles, frame, exchange);
  const auto num_ranks = static_cast<std::size_t>(exchange.num_ranks());
  const std::size_t tolerance = places.size() / (50 * num_ranks);
  std::vector<MortonKey> first = {MortonKey::root()};
  while (first.size() < num_ranks) {
    const std::size_t place = places.size() * first.size() / num_ranks;
    MortonKey node = places[place];
    while (node.level() > level) node = node.parent();
    // The larger the nodes that shares consist of, the fewer cells meet their borders.
    const MortonKey least = places[place - tolerance];
    while (node.level() > 0 && node.parent().range_min() > least) node = node.parent();
    first.push_back(node.range_min());
  }
  return Shares(std::move(first));
}

void deal_triangles(RawSurface& surface, std::uint64_t first_id, std::span<const SheetId> groups,
                    const Frame& frame, const Shares& shares, Exchange& exchange, CommonStop& stop,
                    IngestWatch& watch) {
  TriangleList& part = surface.triangles.front();
  Dealer dealer(surface.spill, first_id, groups, frame, shares, exchange);
  std::vector<Triangle> extent;
  std::size_t num_sent = 0;
  const auto has_more = [&] { return num_sent < part.extents.size(); };
  do {
    dealer.begin_round();
    for (; has_more() && dealer.has_room(); ++num_sent) {
      surface.spill.read_extent(part, num_sent, extent);
      for (const Triangle& triangle : extent) dealer.send(triangle);
      watch.advance(extent.size());
    }
    stop.meet();
    dealer.end_round();
  } while (any(exchange, has_more()));
  surface.spill.release(std::move(part));
  surface.triangles = std::move(dealer).lists();
}

}  // namespace locvol
