#include "engine/ingest/polyline_file.h"

#include <fmt/format.h>

#include <bit>
#include <memory>

#include "engine/ingest/input_bytes.h"
#include "engine/ingest/input_file.h"
#include "engine/ingest/text_scanner.h"
#include "octree/mix.h"

namespace locvol {
namespace {

class PolylineReader {
 public:
  using Take = std::function<void(const PolylinePoint&)>;

  PolylineReader(InputFile& file, const Take& take)
      : file_(file), scanner_(file, '#'), take_(take) {}

  std::string run() {
    while (scanner_.next_line()) take_polyline();
    if (num_polylines_ == 0)
      file_.refuse(
          "holds no polyline: give one in each line, the number of its points and their "
          "coordinates");
    return fmt::format("{:016x}", hash_);
  }

 private:
  void take_polyline() {
    const std::int64_t num_points = scanner_.integer(scanner_.word(), "number of points");
    if (num_points < 2)
      file_.refuse_line(fmt::format("a polyline of {} points: give two or more", num_points));
    hash_ = mix(hash_ ^ static_cast<std::uint64_t>(num_points));
    PolylinePoint point{.position = {}, .is_first = true, .line = file_.line_number()};
    for (std::int64_t n = 0; n < num_points; ++n) {
      for (const int axis : {0, 1, 2}) {
        if (scanner_.at_line_end())
          file_.refuse_line(fmt::format(
              "a polyline of {} points has {} coordinates: give all of them in its line",
              num_points, 3 * n + axis));
        point.position[axis] = scanner_.coordinate() + 0.0;
        hash_ = mix(hash_ ^ std::bit_cast<std::uint64_t>(point.position[axis]));
      }
      take_(point);
      point.is_first = false;
    }
    if (!scanner_.at_line_end())
      file_.refuse_line(fmt::format("a polyline of {} points goes on with \"{}\"", num_points,
                                    shown(scanner_.word())));
    ++num_polylines_;
  }

  InputFile& file_;
  TextScanner scanner_;
  const Take& take_;
  std::uint64_t hash_ = 0, num_polylines_ = 0;
};

}  // namespace

std::string read_polylines(const std::filesystem::path& file,
                           const std::function<void(const PolylinePoint&)>& take,
                           const StopToken* stop) {
  InputFile input(std::make_shared<InputBytes>(file), stop);
  return PolylineReader(input, take).run();
}

std::string survey_polylines(const std::filesystem::path& file, const StopToken* stop) {
  return file.empty() ? ""
                      : read_polylines(
                            file, [](const PolylinePoint&) {}, stop);
}

}  // namespace locvol
