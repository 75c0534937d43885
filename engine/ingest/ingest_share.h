// IngestShare is the part of one process in the ingest of a surface that several take in together.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "engine/ingest/crease_parts.h"
#include "engine/ingest/part_joiner.h"
#include "engine/ingest/sheet_plan.h"
#include "engine/ingest/surface_check.h"
#include "engine/shared/compensated_sum.h"
#include "engine/shared/input_error.h"
#include "octree/domain_state.h"
#include "octree/key_range.h"
#include "octree/morton_key.h"

namespace locvol {

// Leaves near the surface, in Morton order.
struct CutLeaves {
  std::vector<MortonKey> keys;
  std::vector<CornerStates> corners;  // their center_to_corners()
};

// Of the sheets of a surface, the parts that a process knows.
struct SheetPieces {
  JoinedParts<SheetPart> joined;
  std::vector<SheetBorder> borders;   // of these
  std::vector<std::uint32_t> places;  // by part of this process, its place among all
};

// What a sheet's triangles sum up to.
struct SheetSums {
  std::uint64_t first_triangle = std::numeric_limits<std::uint64_t>::max(), num_triangles = 0;
  CompensatedSum area;
  std::array<CompensatedSum, 3> moment;  // three times its area's, by axis
  Box box;                               // if there are triangles

  void add(const Triangle& triangle);
  void add(const SheetSums& others);
  void put_into(SheetFacts& facts) const;
};

// A process judges the cells of a range of keys, and stores the leaves that begin in it. What it
// finds is then joined with what others found: all call the same functions in the same order, and
// each leaves the same on all. This one has all of a surface, and nothing to join.
class IngestShare {
 public:
  virtual ~IngestShare() = default;
  virtual KeyRange range() const { return {}; }
  // It is asked before triangles are changed, which only a process with all of the surface does.
  virtual void require_whole() const {}
  virtual void join_findings(SurfaceFindings&) const {}
  virtual void join_parities(std::vector<bool>&) const {}  // of sums, element by element
  virtual void join_cells(std::optional<std::vector<MortonKey>>&) const {}  // nothing: too many
  virtual void join_sheets(SheetPieces&) const {}
  virtual void join_creases(CreasePieces&) const {}
  virtual void join_sums(std::vector<SheetSums>&) const {}  // by sheet
  virtual void join_leaves(CutLeaves&) const {}
  // What each process says, in their order.
  virtual std::vector<std::string> gather(std::string own) const { return {std::move(own)}; }
  // Throws InputError, for what all know.
  [[noreturn]] void refuse(const std::string& what) const {
    let_first_speak();
    throw InputError(what);
  }

 private:
  virtual void let_first_speak() const {}  // returns on that one alone
};

}  // namespace locvol
