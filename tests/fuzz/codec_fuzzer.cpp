// Arbitrary bytes as a record: decode() gives a record that keeps what records.h says of it, takes
// memory in proportion to the bytes, or throws DecodeError; and what it gives, encode() and
// decode() carry on unchanged.
//
//   | kind and stage u8 | bytes ... |
//
// The kind of record is the first byte's low 3 bits. The next 2 say at which stage the bytes stand
// in for the true ones, for neither a checksum nor a leaf's key is hit by chance:
//   0  as they are stored;   1  before compression;   2 and 3  fields only, behind the header.

#include <zstd.h>

#include <cmath>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <type_traits>

#include "storage/codec.h"
#include "tests/fuzz/expect.h"

namespace locvol {
namespace {

enum Stage { kStored = 0, kContent = 1, kFields = 2 };

constexpr std::size_t kHeaderBytes = 13;  // kind, leaf, version
constexpr MortonKey kLeaf = MortonKey::from_bits(0x0123456789abc000);

template <class Record>
constexpr MortonKey leaf_of() {
  constexpr bool has_leaf =
      !std::is_same_v<Record, StoreFormat> && !std::is_same_v<Record, RunRecord>;
  return has_leaf ? kLeaf : MortonKey();
}

// -- Frames and headers, as codec.cpp draws them -------------------------------------------------

std::string frame_of(std::string_view content) {
  struct Free {
    void operator()(ZSTD_CCtx* context) const { ZSTD_freeCCtx(context); }
  };
  static const std::unique_ptr<ZSTD_CCtx, Free> context(ZSTD_createCCtx());
  ZSTD_CCtx_setParameter(context.get(), ZSTD_c_checksumFlag, 1);
  std::string frame(ZSTD_compressBound(content.size()), '\0');
  frame.resize(
      ZSTD_compress2(context.get(), frame.data(), frame.size(), content.data(), content.size()));
  return frame;
}

std::string content_of(std::string_view frame) {
  std::string content(ZSTD_getFrameContentSize(frame.data(), frame.size()), '\0');
  ZSTD_decompress(content.data(), content.size(), frame.data(), frame.size());
  return content;
}

template <class Record>
std::string header_of() {
  return content_of(encode(Record(), leaf_of<Record>())).substr(0, kHeaderBytes);
}

// -- What codec.h promises of a record; its order is for those to check who rely on it ------------

void expect_sound(const StoreFormat&) {}

void expect_sound(const RunRecord& run) {
  expect(run.parameters.init <= Initialization::kPaper, "an initialization that there is");
  expect(run.parameters.inside <= InsideRule::kWrap, "a rule for what is inside that there is");
  expect(run.phase <= Phase::kDone, "a phase that there is");
  expect(run.frame.unit() > 0 && std::isfinite(run.frame.unit()), "the octree has a size");
}

void expect_sound(const LeafInfo&) {}

void expect_sound(const LeafPoints& record) {
  for (const MeshPoint& p : record.points)
    expect(p.kind <= PointKind::kInserted, "a kind of point that there is");
}

void expect_sound(const LeafCells& record) {
  for (const auto& cell : record.cells)
    for (const std::uint32_t corner : cell)
      expect(corner < record.vertices.size(), "cells have vertices that are there");
}

void expect_sound(const LeafFacets& record) {
  for (const MeshFacet& facet : record.facets)
    for (const std::uint32_t corner : facet.vertices)
      expect(corner < record.vertices.size(), "facets have vertices that are there");
}

void expect_sound(const LeafSurface& record) {
  for (const CreaseEdge& edge : record.creases)
    expect(edge.ends[0] < edge.ends[1] && edge.crease >= 1, "an edge of a crease has two ends");
}

void expect_sound(const LeafUnresolved& record) {
  for (const UnresolvedSite& site : record.sites)
    expect(1 <= site.condition && site.condition <= kNumSiteConditions,
           "a condition that there is");
}

void expect_sound(const QueueEntry&) {}

// ------------------------------------------------------------------------------------------------

// What was written by an earlier version is written anew.
bool is_of_this_version(std::string_view stored, std::string_view again) {
  return content_of(stored).substr(0, kHeaderBytes) == content_of(again).substr(0, kHeaderBytes);
}

template <class Record>
void decode_stored(std::string_view stored) {
  constexpr MortonKey leaf = leaf_of<Record>();
  Record record;
  try {
    record = decode<Record>(stored, leaf);
  } catch (const DecodeError&) {
    return;
  }
  expect_sound(record);
  const std::string again = encode(record, leaf);
  expect(encode(decode<Record>(again, leaf), leaf) == again, "a record survives its encoding");
  // LeafSurface alone may have been written in two ways, one of them longer: with a corner twice.
  if constexpr (!std::is_same_v<Record, LeafSurface>)
    expect(!is_of_this_version(stored, again) || content_of(stored) == content_of(again),
           "a record is written in one way");
}

template <class Record>
void decode_at(int stage, std::string_view bytes) {
  if (stage == kStored)
    decode_stored<Record>(bytes);
  else if (stage == kContent)
    decode_stored<Record>(frame_of(bytes));
  else
    decode_stored<Record>(frame_of(header_of<Record>().append(bytes)));
}

void decode_any(std::uint8_t selector, std::string_view bytes) {
  const int stage = selector >> 4 & 3;
  switch (selector & 15) {
    case 0:
      return decode_at<StoreFormat>(stage, bytes);
    case 1:
      return decode_at<RunRecord>(stage, bytes);
    case 2:
      return decode_at<LeafInfo>(stage, bytes);
    case 3:
      return decode_at<LeafPoints>(stage, bytes);
    case 4:
      return decode_at<LeafCells>(stage, bytes);
    case 5:
      return decode_at<LeafSurface>(stage, bytes);
    case 6:
      return decode_at<LeafUnresolved>(stage, bytes);
    case 7:
      return decode_at<LeafFacets>(stage, bytes);
    default:
      return decode_at<QueueEntry>(stage, bytes);
  }
}

}  // namespace
}  // namespace locvol

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  locvol::decode_any(data[0], bytes.substr(1));
  return 0;
}
