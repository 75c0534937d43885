#include "engine/ingest/cad_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstring>
#include <span>
#include <utility>
#include <vector>

#include "engine/ingest/input_file.h"
#include "engine/ingest/sha256.h"
#include "engine/ingest/surface_groups.h"
#include "engine/shared/input_error.h"
#include "engine/shared/memory_budget.h"
#include "engine/shared/partial_file.h"
#include "engine/shared/standard_input.h"
#include "octree/geometry.h"

namespace locvol {
namespace {

constexpr std::string_view kDigestPrefix = "locvol faces\n";  // so that no mesh has the same

std::filesystem::path program_for(const InputBytes& bytes, CadFormat format) {
  const auto program = CadProcess::program();
  if (!program)
    bytes.refuse(fmt::format(
        "is a {} file, which the package locvol-cad reads, and that is not installed: install it "
        "(apt install ./locvol-cad_*.deb), or export the model as STL",
        kCadFormatNames[static_cast<std::size_t>(format)]));
  return *program;
}

template <class Value>
Value value_in(const std::string& bytes) {
  Value value;
  std::memcpy(&value, bytes.data(), std::min(sizeof value, bytes.size()));
  return value;
}

// What a law asked for, as the sink takes it.
class FacesTaken {
 public:
  FacesTaken(SurfaceSink& sink, std::string file, const CadCut& cut, const CadFacts& facts)
      : sink_(sink),
        file_(std::move(file)),
        has_bodies_(cut.has_bodies && facts.num_bodies > 1),
        has_numbers_(facts.num_faces <= SurfaceGroups::kMaxGroups) {}

  // False: that was the last.
  bool take(const CadProcess::Record& record) {
    if (record.kind == CadRecord::kBody && has_bodies_)
      take_body(record.bytes);
    else if (record.kind == CadRecord::kFace)
      take_face(record.bytes.substr(sizeof(CadColor)), value_in<CadColor>(record.bytes));
    else if (record.kind == CadRecord::kTriangles)
      take_triangles(record.bytes);
    else if (record.kind == CadRecord::kNote)
      sink_.note(record.bytes);
    return record.kind != CadRecord::kEnd;
  }

 private:
  void take_body(const std::string& name) {
    ++num_bodies_;
    sink_.body(name.empty() ? fmt::format("body {}", num_bodies_) : name, file_);
  }
  void take_face(const std::string& name, const CadColor& color) {
    ++num_faces_;
    sink_.group(name.empty() && has_numbers_ ? fmt::format("face {}", num_faces_) : name);
    if (color.is_given != 0) sink_.color({color.red, color.green, color.blue});
  }
  void take_triangles(const std::string& bytes) {
    for (std::size_t place = 0; place + sizeof(CadTriangle) <= bytes.size();
         place += sizeof(CadTriangle)) {
      CadTriangle c;
      std::memcpy(&c, bytes.data() + place, sizeof c);
      if (!std::ranges::all_of(c, [](double v) { return std::isfinite(v); }))
        throw InputError(
            fmt::format("{}: face {} has a point that is not finite; repair it in a CAD program",
                        file_, num_faces_));
      sink_.facet({Point{c[0], c[1], c[2]}, Point{c[3], c[4], c[5]}, Point{c[6], c[7], c[8]}});
    }
  }

  SurfaceSink& sink_;
  std::string file_;
  bool has_bodies_, has_numbers_;
  std::uint64_t num_bodies_ = 0, num_faces_ = 0;
};

// What a file takes once it is read, and while it is: measured, see README.md.
void require_memory(const InputBytes& bytes, std::uint64_t num_bytes, CadFormat format,
                    std::uint64_t cap) {
  constexpr std::uint64_t kProgram = std::uint64_t{64} << 20;
  const std::uint64_t needed = kProgram + (format == CadFormat::kBrep ? 10 : 25) * num_bytes;
  if (cap == 0 || needed <= cap) return;
  throw OverBudget(
      fmt::format("{}: its {} bytes may take {} MiB of memory while they are read, but the cap is "
                  "{} MiB; raise it, by --memory {}M",
                  bytes.path().string(), num_bytes, (needed >> 20) + 1, cap >> 20,
                  (needed >> 20) + 1),
      needed);
}

// What the program is to read of what is packed, or came through a pipe.
OpenFile copied(InputFile& file, const std::filesystem::path& directory) {
  constexpr std::size_t kAtOnce = std::size_t{1} << 18;
  OpenFile copy = OpenFile::temporary(directory / "locvol-cad");
  std::uint64_t place = 0;
  for (std::string_view next = file.peek(kAtOnce); !next.empty(); next = file.peek(kAtOnce)) {
    const std::size_t count = next.size();
    copy.write_at(place, std::as_bytes(std::span(next)));
    place += count;
    file.take(count);
  }
  return copy;
}

// For who asks for no size.
CadLaw usual_law(const CadFacts& facts) {
  constexpr double kOfLongestSide = 1e-4, kDegrees = 20;
  double longest = 0;
  for (std::size_t axis = 0; axis < 3; ++axis)
    longest = std::max(longest, facts.max[axis] - facts.min[axis]);
  return {kOfLongestSide * longest, kDegrees};
}

bool is_iges(std::string_view head) {
  constexpr std::size_t kLine = 80, kSection = 72;
  const std::string_view line = head.substr(0, head.find_first_of("\r\n"));
  if (line.size() != kLine || line[kSection] != 'S') return false;
  const std::string_view number = line.substr(kSection + 1);
  return number.ends_with('1') && std::ranges::all_of(number.substr(0, number.size() - 1),
                                                      [](char c) { return c == ' ' || c == '0'; });
}

}  // namespace

std::optional<CadFormat> cad_format_of(std::string_view head) {
  if (is_iges(head)) return CadFormat::kIges;
  for (bool is_comment = true; is_comment;) {
    while (!head.empty() && std::isspace(static_cast<unsigned char>(head.front())))
      head.remove_prefix(1);
    const std::size_t end = head.starts_with("/*") ? head.find("*/") : head.npos;
    is_comment = end != head.npos;
    if (is_comment) head.remove_prefix(end + 2);
  }
  if (head.starts_with("ISO-10303-21")) return CadFormat::kStep;
  if (head.starts_with("DBRep_DrawableShape") || head.starts_with("CASCADE Topology V"))
    return CadFormat::kBrep;
  return std::nullopt;
}

std::optional<CadFormat> cad_format_of(const std::shared_ptr<const InputBytes>& bytes) {
  constexpr std::size_t kHeadBytes = 4096;
  return cad_format_of(InputFile(bytes).peek(kHeadBytes));
}

std::string digest_of_cad(const std::shared_ptr<const InputBytes>& bytes, const StopToken* stop) {
  Sha256 hash;
  hash.update(kDigestPrefix.data(), kDigestPrefix.size());
  const std::string of_bytes = InputFile(bytes, stop).digest();
  hash.update(of_bytes.data(), of_bytes.size());
  return hash.hex_digest();
}

CadFile::CadFile(std::shared_ptr<const InputBytes> bytes, CadFormat format,
                 const std::filesystem::path& directory, std::uint64_t cap, const StopToken* stop)
    : bytes_(std::move(bytes)), digest_(digest_of_cad(bytes_, stop)) {
  const std::filesystem::path program = program_for(*bytes_, format);
  InputFile file(bytes_, stop);
  require_memory(*bytes_, file.size(), format, cap);
  if (file.is_unpacked() || bytes_->is_copy() || bytes_->path() == kStandardInput)
    copy_.emplace(copied(file, directory));
  process_.emplace(program, bytes_->path(), format, copy_ ? &*copy_ : nullptr);
  for (;;) {
    const CadProcess::Record record = next(stop);
    if (record.kind == CadRecord::kFacts) {
      facts_ = value_in<CadFacts>(record.bytes);
      return;
    }
    notes_.push_back(record.bytes);
  }
}

// What is said of a file that cannot be read ends here.
CadProcess::Record CadFile::next(const StopToken* stop) {
  auto record = process_->next(stop);
  if (!record)
    bytes_->refuse(
        "OpenCASCADE has crashed while it read this: it is damaged; fetch or export it again, or "
        "export the model as STL");
  if (record->kind == CadRecord::kRefusal) bytes_->refuse(record->bytes);
  if (record->kind == CadRecord::kOutOfMemory)
    bytes_->refuse("there is not enough memory to read it");
  return *std::move(record);
}

void CadFile::parse(const CadCut& cut, SurfaceSink& sink, const StopToken* stop) {
  for (const std::string& note : notes_) sink.note(note);
  if (const std::string unit = facts_.unit.data(); !unit.empty())
    sink.note(fmt::format("lengths are in the file's unit, {}", unit));
  if (facts_.num_faces > SurfaceGroups::kMaxGroups)
    sink.note(fmt::format("has {} faces, more than {}: those without a name get none",
                          facts_.num_faces, SurfaceGroups::kMaxGroups));
  sink.precision(facts_.precision);
  process_->ask(cut.law.deflection > 0 ? cut.law : usual_law(facts_));
  FacesTaken taken(sink, bytes_->path().string(), cut, facts_);
  while (taken.take(next(stop))) {
  }
}

}  // namespace locvol
