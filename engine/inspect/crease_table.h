// How much of each crease of the surface a finished mesh keeps.
#pragma once

#include <cstdint>
#include <vector>

#include "engine/exchange/exchange.h"
#include "engine/exchange/one_rank.h"
#include "engine/output/kept_creases.h"
#include "octree/stop.h"
#include "storage/store.h"

namespace locvol {

struct CreaseTable {
  std::vector<KeptCrease> kept;  // by id, from 1 on
  double length = 0;             // of all creases of the surface
  // Of those that are not whole, what is not kept, and how many they are. What is shorter than
  // three times what creases are told apart by is not missed.
  double lost_length = 0;
  std::vector<CreaseId> not_whole;
  std::uint64_t num_corners = 0;  // that are vertices of the mesh

  double kept_length() const { return length - lost_length; }
};

// Streams over what the mesh has around creases; of a run that keeps none, nothing is read. Memory:
// what VertexNumbering and KeptCreases take. Nameless files lie in the store's directory. Throws
// StoreError unless the store holds a finished run; CorruptRecord, std::system_error, Stopped.
// `exchange`: of the ranks that have the mesh together, which all call it and get the same.
CreaseTable crease_table(const Store& store, const StopToken* stop = nullptr,
                         Exchange& exchange = alone());

}  // namespace locvol
