#include "tools/results.h"

#include <gtest/gtest.h>

#include <limits>

#include "engine/run/leaf_queue.h"
#include "tests/engine/plan/changed_parameters.h"

namespace locvol {
namespace {

AuditReport valid_report() {
  AuditReport report;
  report.num_cells = 10;
  report.num_components = report.surface_num_components = 1;
  report.euler_characteristic = report.surface_euler_characteristic = -4;
  return report;
}

TEST(BytesText, HasThreeDigits) {
  EXPECT_EQ(bytes_text(0), "0 B");
  EXPECT_EQ(bytes_text(999), "999 B");
  EXPECT_EQ(bytes_text(1000), "1 kB");
  EXPECT_EQ(bytes_text(1234567), "1.23 MB");
  EXPECT_EQ(bytes_text(999'999), "1 MB");
  EXPECT_EQ(bytes_text(5'000'000'000'000'000), "5e+03 TB");
}

TEST(CountText, HasThreeDigits) {
  EXPECT_EQ(count_text(0), "0");
  EXPECT_EQ(count_text(999), "999");
  EXPECT_EQ(count_text(12345), "12.3 thousand");
  EXPECT_EQ(count_text(999'600), "1 million");
  EXPECT_EQ(count_text(9'943'962), "9.94 million");
  EXPECT_EQ(count_text(1.011e9), "1.01 billion");
}

TEST(EstimateText, GivesRanges) {
  RunEstimate estimate;
  estimate.size = 0.01;
  estimate.num_cells = 1.15e6;
  estimate.output.file_bytes = 1.15e8;
  estimate.store_bytes = 1.7e7;
  estimate.seconds = {0, 0, 10, 0, 0};
  const std::string text = estimate_text(estimate, MeshFormat::kVtkHdf, 2, std::uint64_t{96} << 20);
  EXPECT_EQ(text,
            "size λ           0.01\n"
            "cells            about 1.15 million (1 million to 1.32 million)\n"
            "store            about 17 MB (10 MB to 28.9 MB)\n"
            "mesh file        about 115 MB (95.8 MB to 138 MB), as vtkhdf\n"
            "time             about 10 s (4 s to 25 s), on 2 threads\n"
            "memory           at least 96M; with more, it is faster\n");
  estimate.is_thin = true;
  EXPECT_NE(brief_estimate_text(estimate, 1).find("several times as much"), std::string::npos);
  EXPECT_EQ(to_json(estimate)["seconds"]["high"], 25);
}

TEST(PointText, RoundTrips) {
  EXPECT_EQ(point_text({0.1, -0.0, 1.0 / 3}), "(0.1, -0, 0.3333333333333333)");
}

TEST(Genus, IsTheSumOverComponents) {
  EXPECT_EQ(genus(1, 2), 0);
  EXPECT_EQ(genus(1, -4), 3);
  EXPECT_EQ(genus(3, 6), 0);
  EXPECT_EQ(genus(2, 0), 2);  // two tori
}

TEST(AuditText, SetsMeshBesideInput) {
  const std::string text = audit_text(valid_report());
  EXPECT_NE(text.find("genus                                     3              3\n"),
            std::string::npos)
      << text;
  EXPECT_EQ(text.find("BAD"), std::string::npos) << text;
  EXPECT_TRUE(text.ends_with("\nvalid\n")) << text;
}

TEST(AuditText, SetsCreasesBesideThoseOfTheInput) {
  AuditReport report = valid_report();
  EXPECT_EQ(audit_text(report).find("crease"), std::string::npos);
  report.crease_length = report.surface_crease_length = 24;
  report.lost_crease_length = 6;
  report.num_lost_creases = 3;
  const std::string text = audit_text(report);
  for (const char* line : {"\ncreases                                  18             24\n",
                           "\ncreases kept 75%\n", "BAD: 3 pieces of creases that are no edges\n"})
    EXPECT_NE(text.find(line), std::string::npos) << line << " in\n" << text;
  const Json json = to_json(report);
  EXPECT_EQ(json["mesh"]["crease_length"], 18);
  EXPECT_EQ(json["input"]["crease_length"], 24);
  EXPECT_EQ(json["lost_crease_length"], 6);
  EXPECT_EQ(json["violations"]["lost_creases"], 3);
  EXPECT_EQ(json["violations"]["lost_corners"], 0);
}

TEST(SummaryText, TellsHowMuchOfCreasesIsKept) {
  RunSummary summary;
  SheetFacts wall;
  wall.name = wall.group = "wall";
  summary.sheets.sheets = {wall};
  summary.sheets.creases = {{.num_edges = 3, .length = 6}, {.num_edges = 1, .length = 2}};
  summary.sheets.num_corners = 1;
  EXPECT_NE(summary_text(summary).find("\ncreases          2 (8 long), 1 corner\n"),
            std::string::npos);
  CreaseTable kept;
  kept.kept.resize(2);
  kept.kept[0].length = 6;
  kept.kept[1].length = 2;
  kept.length = 8;
  EXPECT_NE(
      summary_text(summary, &kept).find("\ncreases          2 (8 long, 100% kept), 1 corner\n"),
      std::string::npos);
  kept.kept[1].length = 1;
  kept.lost_length = 1;
  kept.not_whole = {2};
  const std::string text = summary_text(summary, &kept);
  EXPECT_NE(text.find("\ncreases          2 (8 long, 87.5% kept), 1 corner\n"
                      "not whole        1 crease: wall/wall_2\n"),
            std::string::npos)
      << text;
  Json json;
  add_kept_creases(summary.sheets, kept, json);
  EXPECT_EQ(json["kept_crease_length"], 7);
  EXPECT_EQ(json["creases_not_whole"], Json({2}));
  EXPECT_EQ(json["creases"][1]["name"], "wall/wall_2");
  EXPECT_EQ(json["creases"][1]["kept_length"], 1);
  kept.lost_length = 1e-9;
  EXPECT_EQ(kept_share_text(kept), "99.99%");
}

TEST(StatisticsText, SaysBesideTheBoundWhatIsExcusedFromIt) {
  RunRecord run;
  run.parameters.size = 1;
  run.surface.volume = 1;
  MeshStatistics statistics;
  statistics.max_radius_edge_ratio = 2.9;
  statistics.max_bounded_ratio = 1.9;
  statistics.num_above_ratio = 2;
  EXPECT_NE(statistics_text(statistics, run).find("radius-edge ratios, at most 2.9\n"),
            std::string::npos);
  run.has_creases = true;
  const std::string text = statistics_text(statistics, run);
  EXPECT_NE(text.find("radius-edge ratios, at most 1.9\n"), std::string::npos) << text;
  EXPECT_NE(
      text.find("\nslender cells    2, with radius-edge ratios of 2 to 2.9, beside creases\n"),
      std::string::npos)
      << text;
}

TEST(AuditText, NamesEveryViolation) {
  AuditReport report = valid_report();
  report.num_bad_boundary_edges = 2;
  report.num_large_cells = 1;
  report.violations = {"edge 3 7"};
  const std::string text = audit_text(report);
  EXPECT_NE(text.find("BAD: 2 boundary edges"), std::string::npos) << text;
  EXPECT_NE(text.find("BAD: 1 cells with a circumradius"), std::string::npos) << text;
  EXPECT_NE(text.find("  edge 3 7\n"), std::string::npos) << text;
  EXPECT_TRUE(text.ends_with("\nNOT VALID\n")) << text;
}

TEST(AuditText, TellsPoorCellsAndFindsTheMeshValid) {
  AuditReport report = valid_report();
  EXPECT_EQ(audit_text(report).find("poor cells"), std::string::npos);
  report.min_dihedral_bound = 15;
  EXPECT_NE(audit_text(report).find("\npoor cells 0, with a dihedral angle below 15°\n"),
            std::string::npos);
  report.num_poor_cells = 2;
  report.min_dihedral_degrees = 12.5;
  report.worst_leaf = MortonKey::root();
  report.worst_place = {1, 2.5, -3};
  const std::string text = audit_text(report);
  EXPECT_NE(text.find("\npoor cells 2, with a dihedral angle below 15°; the worst at (1, 2.5, -3), "
                      "leaf 8000000000000000\n"),
            std::string::npos)
      << text;
  EXPECT_TRUE(text.ends_with("\nvalid\n")) << text;
  const Json json = to_json(report);
  EXPECT_EQ(json["is_valid"], true);
  EXPECT_EQ(json["num_poor_cells"], 2);
  EXPECT_EQ(json["min_dihedral_bound"], 15);
  EXPECT_EQ(json["smallest_angle_at"]["leaf"], "8000000000000000");
}

TEST(StatisticsText, TellsPoorCellsIfThereIsABound) {
  MeshStatistics statistics;
  RunRecord run;
  run.surface.volume = 1;
  EXPECT_EQ(statistics_text(statistics, run).find("poor"), std::string::npos);
  statistics.min_dihedral_bound = 15;
  statistics.num_poor_cells = 3;
  const std::string text = statistics_text(statistics, run);
  EXPECT_NE(text.find("\npoor cells       3, with a dihedral angle below 15°\n"), std::string::npos)
      << text;
  EXPECT_EQ(to_json(statistics, run)["num_poor_cells"], 3);
  EXPECT_EQ(to_json(statistics, run)["num_forced_cells"], 0);
  statistics.num_forced_cells = 2;
  const std::string of_walls = statistics_text(statistics, run);
  EXPECT_NE(of_walls.find("below 15°; 2 forced by thin walls or acute creases\n"),
            std::string::npos)
      << of_walls;
  EXPECT_EQ(to_json(statistics, run)["num_forced_cells"], 2);
}

TEST(ParametersText, TellsTheBoundOnAngles) {
  RunParameters parameters;
  const char* any =
      "bounds           radius-edge ratio 2, dihedral angles any, spacing floor 0.02 λ";
  parameters.spacing_floor = 0.02;
  EXPECT_NE(parameters_text(parameters).find(any), std::string::npos);
  parameters.min_dihedral = 15;
  EXPECT_NE(parameters_text(parameters).find("dihedral angles at least 15°, "), std::string::npos);
  EXPECT_EQ(to_json(parameters)["min_dihedral"], 15);
}

TEST(ParametersText, TellsEachOption) {
  RunParameters parameters;
  parameters.size = 0.1;
  for_each_change(parameters, [&](const auto& option, const RunParameters& changed) {
    EXPECT_NE(parameters_text(changed), parameters_text(parameters)) << option.name.key;
    EXPECT_NE(to_json(changed)[option.name.key], to_json(parameters)[option.name.key])
        << option.name.key;
  });
}

TEST(PoorCellText, NamesAnglePlaceAndLeaf) {
  const LeafPoorCell cell{MortonKey::root(), {1, 2.5, -3}, 0.25, 12.5};
  EXPECT_EQ(poor_cell_text(cell),
            "angle 12.5° at (1, 2.5, -3), radius 0.25, leaf 8000000000000000");
  EXPECT_EQ(to_json(cell)["condition"], "angle");
  EXPECT_EQ(to_json(cell)["min_dihedral_degrees"], 12.5);
  EXPECT_EQ(to_json(cell)["is_forced"], false);
  const LeafPoorCell forced{MortonKey::root(), {1, 2.5, -3}, 0.25, 12.5, true};
  EXPECT_EQ(poor_cell_text(forced), poor_cell_text(cell) + ", forced by a wall or crease");
  EXPECT_EQ(to_json(forced)["is_forced"], true);
}

TEST(StatisticsText, DrawsBarsOfItsHistograms) {
  MeshStatistics statistics;
  statistics.num_cells = 1000;
  statistics.volume = 0.99;
  statistics.dihedral_angles.counts[30] = 4000;   // 59 to 61
  statistics.dihedral_angles.counts[45] = 1999;   // 89 to 91
  statistics.dihedral_angles.counts[90] = 1;      // 179 and more
  statistics.radius_edge_ratios.counts[0] = 998;  // 0.6 to 0.65
  statistics.radius_edge_ratios.counts[28] = 2;   // 2 and more
  RunRecord run;
  run.surface.volume = 1;
  const std::string text = statistics_text(statistics, run);
  EXPECT_EQ(text.find("neighbors"), std::string::npos);  // sizes do not vary
  for (const char* line : {"volume           0.99, -1% of the input's 1\n",
                           "  55-65  66.7% ################   1.2-1.3\n",
                           "  85-95  33.3% ########           1.5-1.6\n",
                           "    0-5                           0.6-0.7  99.8% ################\n",
                           "175-180 < 0.1% .\n", " 2.0-   0.2% .\n"})
    EXPECT_NE(text.find(line), std::string::npos) << line << " in\n" << text;
}

TEST(StatisticsText, TellsOfSizesThatVary) {
  MeshStatistics statistics;
  statistics.num_cells = 1000;
  statistics.num_cells_by_octave = {{-4, 600}, {-3, 400}};
  statistics.radii_over_size.counts[18] = 999;  // 0.9 to 0.95
  statistics.radii_over_size.counts[0] = 1;
  statistics.max_radius_over_size = 0.9375;
  statistics.max_neighbor_ratio = 2.5;
  RunRecord run;
  run.surface.volume = 1;
  run.surface.area = 6;
  run.parameters.size = 0.1;
  run.parameters.growth = 0.2;
  const double num_uniform = num_uniform_cells(run);
  EXPECT_GT(num_uniform, 2000);
  const std::string text = statistics_text(statistics, run);
  for (const char* line :
       {"neighbors        circumradii at most 2.5 times each other's\n",
        "circumradius over that size, at most 0.9375\n",
        "0.0625-  60.0% ################   0.0-0.1   0.1% .\n",
        " 0.125-  40.0% ###########        0.1-0.2\n", "0.9-1.0  99.9% ################\n"})
    EXPECT_NE(text.find(line), std::string::npos) << line << " in\n" << text;
  const Json json = to_json(statistics, run);
  EXPECT_EQ(json["max_ratio_of_neighbors"], 2.5);
  EXPECT_EQ(json["max_circumradius_over_size"], 0.9375);
  EXPECT_EQ(json["estimated_uniform_cells"], num_uniform);
  EXPECT_EQ(
      json["octaves"],
      Json::parse(R"([{"least": 0.0625, "num_cells": 600}, {"least": 0.125, "num_cells": 400}])"));
}

TEST(AuditJson, AgreesWithTheReport) {
  AuditReport report = valid_report();
  report.num_repeated_cells = 4;
  const Json json = to_json(report);
  EXPECT_EQ(json["is_valid"], false);
  EXPECT_EQ(json["mesh"]["genus"], 3);
  EXPECT_EQ(json["violations"]["repeated_cells"], 4);
  EXPECT_EQ(json["violations"]["large_cells"], 0);
}

TEST(LeafJson, HasAQueuePositionOnlyWhenQueued) {
  LeafInfo info;
  EXPECT_FALSE(to_json(info).contains("queued"));
  info.queued = QueuePosition{3, 5};
  EXPECT_EQ(to_json(info)["queued"], (Json{{"epoch", 3}, {"color", 5}}));
  info.queued->color = kNoColor;  // waits for an epoch that has not begun
  EXPECT_EQ(to_json(info)["queued"], (Json{{"epoch", 3}, {"color", nullptr}}));
}

TEST(SiteText, NamesConditionPlaceAndLeaf) {
  const LeafSite site{MortonKey::root(),
                      {.condition = 3, .position = {1, 2.5, -3}, .radius = 0.25}};
  EXPECT_EQ(site_text(site), "C3 at (1, 2.5, -3), radius 0.25, leaf 8000000000000000");
}

TEST(InsertionsText, NamesConditionsFromC1) {
  const std::vector<std::uint64_t> num_insertions = {1, 2, 3, 4, 5, 6, 7};
  EXPECT_EQ(insertions_text(num_insertions), "C1 1, C2 2, C3 3, C4 4, C5 5, C6 6, C7 7");
  EXPECT_EQ(insertions_json(num_insertions)["C7"], 7);
}

}  // namespace
}  // namespace locvol
