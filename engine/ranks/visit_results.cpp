#include "engine/ranks/visit_results.h"

#include <tuple>

#include "engine/exchange/pack.h"

namespace locvol {

auto fields(Maybe<LatticeCore> auto& core) {
  auto& [is_whole, rows] = core;
  return std::tuple(Field("is_whole", is_whole), Field("rows", rows));
}
auto fields(Maybe<CoverPoints> auto& points) {
  auto& [samples, lattice, core] = points;
  return std::tuple(Field("samples", samples), Field("lattice", lattice), Field("core", core));
}
auto fields(Maybe<FillPoints> auto& points) {
  auto& [centers, met_core] = points;
  return std::tuple(Field("centers", centers), Field("met_core", met_core));
}
auto fields(Maybe<CellPlaces> auto& cells) {
  auto& [leaf, places] = cells;
  return std::tuple(Field("leaf", leaf), Field("places", places));
}
auto fields(Maybe<LeafFacets> auto& list) {
  auto& [vertices, facets] = list;
  return std::tuple(Field("vertices", vertices), Field("facets", facets));
}
auto fields(Maybe<MendedCells> auto& cells) {
  auto& [left_out, others, hanging, facets, reach] = cells;
  return std::tuple(Field("left_out", left_out), Field("others", others), Field("hanging", hanging),
                    Field("facets", facets), Field("reach", reach));
}

}  // namespace locvol

namespace locvol {

template <class Result>
std::string encode_result(const Result& result) {
  return pack(result);
}

template <class Result>
Result decode_result(std::string_view bytes) {
  return unpack<Result>(bytes);
}

template std::string encode_result(const LeafDelta&);
template std::string encode_result(const MendedCells&);
template std::string encode_result(const FillPoints&);
template std::string encode_result(const CoverPoints&);
template std::string encode_result(const std::vector<SizedNode>&);
template std::string encode_result(const std::vector<SizeCube>&);
template LeafDelta decode_result(std::string_view);
template MendedCells decode_result(std::string_view);
template FillPoints decode_result(std::string_view);
template CoverPoints decode_result(std::string_view);
template std::vector<SizedNode> decode_result(std::string_view);
template std::vector<SizeCube> decode_result(std::string_view);

}  // namespace locvol
