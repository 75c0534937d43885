// OUTPUT.faces.json: what is known of each sheet of a mesh, for programs that look for "the face at
// x = 0".
#pragma once

#include <filesystem>
#include <string>

#include "engine/exchange/exchange.h"
#include "engine/exchange/one_rank.h"
#include "engine/inspect/sheet_table.h"
#include "octree/stop.h"
#include "storage/store.h"
#include "tools/results.h"

namespace locvol {

Json to_json(const SheetTable& table);
// What is measured of one, as text.
std::string sheet_text(const SheetRow& row);
// A line for each, of the first ones.
std::string sheet_table_text(const SheetTable& table, std::size_t most_rows);

std::filesystem::path faces_file(const std::filesystem::path& output);
// Measures the sheets of the finished run, and writes the file of faces of an output. Called by all
// ranks, of which the first one writes. `is_split`: see with_both_sides(). Throws what
// sheet_table() does.
void write_faces(const Store& store, const std::filesystem::path& output, bool is_split,
                 const StopToken* stop = nullptr, Exchange& exchange = alone());

}  // namespace locvol
