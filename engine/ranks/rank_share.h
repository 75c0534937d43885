// RankShare is a rank's part in the ingest of a surface by all.
#pragma once

#include <exception>
#include <string>
#include <vector>

#include "engine/exchange/exchange.h"
#include "engine/ingest/ingest_share.h"
#include "engine/ranks/common_stop.h"
#include "octree/shares.h"

namespace locvol {

// The surface is one that a single process has to take in: thrown on all ranks.
class NeedsOneProcess : public std::exception {};

// Memory while all is joined, on each rank: 9 bytes a leaf near the surface, 200 a component, and
// 32 for each triangle that lies across the borders of its share.
class RankShare : public IngestShare {
 public:
  RankShare(const Shares& shares, Exchange& exchange, CommonStop& stop)
      : shares_(shares), exchange_(exchange), stop_(stop) {}

  KeyRange range() const override { return shares_.range_of(exchange_.rank()); }
  void require_whole() const override { throw NeedsOneProcess(); }
  // Throws NeedsOneProcess where something is to be repaired, or what is wrong does not have the
  // same name wherever it is looked at.
  void join_findings(SurfaceFindings& findings) const override;
  void join_parities(std::vector<bool>& parities) const override;
  void join_cells(std::optional<std::vector<MortonKey>>& cells) const override;
  void join_sheets(SheetPieces& pieces) const override;
  void join_creases(CreasePieces& pieces) const override;
  void join_sums(std::vector<SheetSums>& sums) const override;
  void join_leaves(CutLeaves& leaves) const override;
  std::vector<std::string> gather(std::string own) const override;

 private:
  void let_first_speak() const override;  // the others end with it

  const Shares& shares_;
  Exchange& exchange_;
  CommonStop& stop_;
};

}  // namespace locvol
