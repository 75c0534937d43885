// The creases around a leaf as the audit sees them, by other code than keeps them: which points
// follow each other on them, and which edges of cells lead from sheet to sheet.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "engine/audit/audit_leaf.h"

namespace locvol {

class AuditCreases {
 public:
  // All must outlive it. Of a leaf without creases near, it is empty.
  AuditCreases(const AuditLeaf& leaf, const AuditLeaves& leaves, const AuditRecords& records,
               const AuditBounds& bounds);

  // From a point on a crease to the next, or as far as the crease is loaded, or goes. Its pieces
  // are parts of edges, in a row.
  struct Way {
    std::array<LocalIndex, 2> ends;  // ascending: kUnknownPoint where there is no point
    double length = 0;
    std::uint32_t first_piece = 0, num_pieces = 0;
  };
  using Piece = std::array<Point, 2>;
  std::span<const Way> ways() const { return ways_; }
  std::span<const Piece> pieces(const Way& way) const {
    return std::span(pieces_).subspan(way.first_piece, way.num_pieces);
  }

  // The point on a crease that stands for a place: the nearest that is closer than creases are told
  // apart, or kUnknownPoint.
  LocalIndex point_for(const Point& place) const;

  // Of edges of cells: do they join points on the surface that lie on no common sheet, or on sides
  // of one that face each other, or points on creases that do not follow each other? Reads the
  // triangles there.
  std::vector<bool> lead_across(std::span<const std::array<LocalIndex, 2>> edges) const;

 private:
  struct Link;  // a piece between two nodes
  std::vector<Link> cut_edges(std::vector<LocalIndex>& point_at);
  void follow(std::span<const Link> links, std::span<const LocalIndex> point_at);
  struct NearSheet;  // and where it is closest
  std::vector<std::vector<NearSheet>> sheets_at(std::span<const LocalIndex> vertices) const;
  static bool leads_across(std::span<const NearSheet> from, std::span<const NearSheet> to,
                           bool is_on_crease);

  const AuditLeaf& leaf_;
  const AuditLeaves& leaves_;
  const AuditRecords& records_;
  const AuditBounds& bounds_;
  std::vector<LocalIndex> crease_points_;
  AuditGrid grid_;               // of these
  std::vector<Point> vertices_;  // ends of edges, ascending
  std::vector<bool> is_corner_;  // of these
  std::vector<Way> ways_;
  std::vector<Piece> pieces_;
  std::vector<std::array<LocalIndex, 2>> neighbors_;  // ends of ways, ascending
};

// Is each two points that follow each other an edge of the mesh, and each corner a vertex? What is
// closer than creases are told apart has one vertex.
void check_creases(const AuditLeaf& leaf, const AuditCreases& creases, const Box& box,
                   const AuditBounds& bounds, AuditFindings& findings);

}  // namespace locvol
