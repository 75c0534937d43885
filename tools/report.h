// Results as text for people and as JSON for programs; both from the same structs.
#pragma once

#include <array>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "engine/audit.h"
#include "engine/engine.h"
#include "engine/writer.h"
#include "storage/records.h"
#include "storage/store.h"

namespace locvol {

using Json = nlohmann::ordered_json;  // keeps the order in which fields are set

struct LeafSite {
  MortonKey leaf;
  UnresolvedSite site;
};

Json to_json(const Point& point);
Json to_json(const Box& box);
Json to_json(const SurfaceFacts& facts);
Json to_json(const RunParameters& parameters);
Json to_json(const LeafInfo& info);
Json to_json(const QueueEntry& entry);
Json to_json(const LeafSite& site);
Json to_json(const DatabaseSize& size);
Json to_json(const RunSummary& summary);
Json to_json(const WriteSummary& summary);
Json to_json(const AuditReport& report);
Json insertions_json(const std::array<std::uint64_t, kNumConditions>& num_insertions);

std::string_view init_name(Initialization init);
std::string_view kind_name(PointKind kind);
std::string bytes_text(std::uint64_t bytes);  // "999 B", "1.2 MB": powers of 1000
std::string point_text(const Point& point);   // round-trips
std::string box_text(const Box& box);
std::string site_text(const LeafSite& site);
std::string insertions_text(const std::array<std::uint64_t, kNumConditions>& num_insertions);

// Each ends its lines itself.
std::string facts_text(const SurfaceFacts& facts);
std::string parameters_text(const RunParameters& parameters);
std::string summary_text(const RunSummary& summary);
std::string audit_text(const AuditReport& report);

// Handles' count of a closed surface: the sum over its components.
std::int64_t genus(std::uint64_t num_components, std::int64_t euler_characteristic);

void print_json(const Json& json);

}  // namespace locvol
