#include "engine/ingest/nearest_sheets.h"

#include <algorithm>
#include <cstring>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "engine/plan/part_sizes.h"
#include "refine/domain/closest_point.h"

namespace locvol {
namespace {

struct Nearest {
  double squared = std::numeric_limits<double>::infinity();
  SheetId sheet = 0;

  void take(const Nearest& other) {
    if (std::pair(other.squared, other.sheet) < std::pair(squared, sheet)) *this = other;
  }
};

// Of all processes, by their words.
void join(std::vector<Nearest>& all, const IngestShare& share) {
  std::string own(all.size() * sizeof(Nearest), '\0');
  std::memcpy(own.data(), all.data(), own.size());
  for (const std::string& said : share.gather(own))
    for (std::size_t i = 0; i < all.size(); ++i) {
      Nearest other;
      std::memcpy(&other, said.data() + i * sizeof other, sizeof other);
      all[i].take(other);
    }
}

}  // namespace

std::vector<SheetId> nearest_sheets(const CheckedSurface& surface,
                                    const std::vector<PartSize>& sheet_sizes, IngestWatch& watch,
                                    const IngestShare& share) {
  std::vector<std::pair<std::size_t, Point>> places;  // of which size, where
  for (std::size_t i = 0; i < sheet_sizes.size(); ++i)
    if (const auto place = place_meant_by(sheet_sizes[i].name)) places.emplace_back(i, *place);
  if (places.empty()) return {};
  std::vector<Nearest> all(places.size());
  for (const TriangleBucket& bucket : surface.buckets.all()) {
    const Box box = surface.buckets.frame().box(bucket.cell);
    const auto may_be_in = [&](std::size_t i) {
      return box.squared_distance(places[i].second) <= all[i].squared;
    };
    bool is_asked = false;
    for (std::size_t i = 0; i < places.size(); ++i) is_asked |= may_be_in(i);
    if (!is_asked) continue;
    for (const Triangle& triangle : surface.load(bucket)) {
      watch.advance();
      for (std::size_t i = 0; i < places.size(); ++i)
        all[i].take({squared_distance(triangle, places[i].second), triangle.sheet});
    }
  }
  join(all, share);
  std::vector<SheetId> nearest(sheet_sizes.size(), 0);
  for (std::size_t i = 0; i < places.size(); ++i) nearest[places[i].first] = all[i].sheet;
  return nearest;
}

}  // namespace locvol
