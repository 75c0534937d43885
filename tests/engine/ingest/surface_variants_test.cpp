// Surfaces as the world writes them: each is read alike, and none that is cut off is taken for
// another. Also what gzip has packed, what comes through a pipe, and what is to be converted first.

#include "tests/engine/ingest/surface_variants.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <optional>
#include <random>
#include <stdexcept>
#include <system_error>
#include <thread>

#include "engine/engine.h"
#include "engine/exchange/thread_ranks.h"
#include "engine/formats/writer.h"
#include "engine/ingest/input_file.h"
#include "engine/plan/run_setup.h"
#include "engine/plan/same_run.h"
#include "engine/rank_engine.h"
#include "engine/shared/standard_input.h"
#include "engine/shared/stop_source.h"
#include "tests/directories.h"
#include "tests/engine/file_size_limit.h"
#include "tests/engine/ingest/surface_writers.h"
#include "tests/file_bytes.h"
#include "tests/skip_reasons.h"

namespace locvol {
namespace {

using Corners = std::vector<std::array<Point, 3>>;

// As `gzip` does, with a name in the header if `name` is not empty.
std::string packed(std::string_view bytes, int level = Z_DEFAULT_COMPRESSION) {
  z_stream z{};
  if (deflateInit2(&z, level, Z_DEFLATED, 15 + 16, 8, Z_DEFAULT_STRATEGY) != Z_OK)
    throw std::runtime_error("zlib");
  std::string out(deflateBound(&z, bytes.size()) + 64, '\0');
  z.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
  z.avail_in = static_cast<uInt>(bytes.size());
  z.next_out = reinterpret_cast<Bytef*>(out.data());
  z.avail_out = static_cast<uInt>(out.size());
  if (deflate(&z, Z_FINISH) != Z_STREAM_END) throw std::runtime_error("zlib");
  out.resize(z.total_out);
  deflateEnd(&z);
  return out;
}

void expect_refused(const std::string& message, const std::vector<std::string>& parts) {
  EXPECT_FALSE(message.empty()) << "accepted, but should be refused with: " << parts.front();
  for (const std::string& part : parts)
    EXPECT_NE(message.find(part), std::string::npos) << message << "\nlacks: " << part;
}

// The content alone says of most, but not of these, which format they have.
bool needs_its_name(const std::string& name) {
  return name == "no_keyword.off" || name == "materials_within.obj";
}

Corners corners_of_box() {
  const Polygons box = variant_box();
  Corners corners;
  for (const auto& f : box.faces)
    corners.push_back({box.vertices[f[0]], box.vertices[f[1]], box.vertices[f[2]]});
  return corners;
}

TEST(SurfaceVariants, AreReadAlike) {
  const SurfaceFiles files;
  const Corners expected = corners_of_box();
  const auto variants = surface_variants();
  EXPECT_GE(variants.size(), 100u);
  for (const auto& [name, content] : variants) {
    SCOPED_TRACE(name);
    try {
      const InputSurface s = files.read(name, content);
      EXPECT_EQ(s.corners(), expected);
      EXPECT_EQ(s.facts.num_vertices, 8u);
      EXPECT_DOUBLE_EQ(s.facts.volume, 4);
    } catch (const InputError& error) {
      ADD_FAILURE() << error.what();
    }
  }
}

TEST(SurfaceVariants, AreMeshedAlikeByteByByte) {
  const SurfaceFiles files;
  std::string expected;
  for (const auto& [name, content] : surface_variants()) {
    SCOPED_TRACE(name);
    MeshOptions options;
    options.input = files.write(name, content);
    options.store = files.directory() / (name + ".store");
    options.size = {0.4, false};
    const RunSummary summary = mesh(options);
    ASSERT_EQ(summary.outcome, RunOutcome::kDone);
    const auto out = files.directory() / "mesh.vtu";
    write_mesh(Store::open(options.store), out, {});
    if (expected.empty()) expected = bytes_of(out);
    EXPECT_EQ(bytes_of(out), expected);
    std::filesystem::remove_all(options.store);
  }
  EXPECT_GT(expected.size(), 1000u);
}

// What is accepted is all of it: what is cut off a number, and no more, cannot be noticed, but no
// file here ends in a vertex.
TEST(SurfaceVariants, CutAnywhereTheyAreReadAsTheyWereOrRefused) {
  const SurfaceFiles files;
  const Corners expected = corners_of_box();
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  std::mt19937 random(seed);
  std::size_t num_accepted = 0, num_refused = 0;
  for (const auto& [name, content] : surface_variants()) {
    for (const std::string& whole : {content, packed(content)}) {
      for (int i = 0; i < 10; ++i) {
        const bool is_near_end = i % 2 == 0;
        const std::size_t most =
            std::min<std::size_t>(whole.size(), is_near_end ? 60 : whole.size());
        const std::size_t length = whole.size() - 1 - static_cast<std::size_t>(random()) % most;
        SCOPED_TRACE(testing::Message() << name << " cut at byte " << length);
        try {
          EXPECT_EQ(files.read(name, whole.substr(0, length)).corners(), expected);
          EXPECT_EQ(whole, content) << "packed bytes are whole or refused";
          ++num_accepted;
        } catch (const InputError& error) {
          EXPECT_NE(std::string(error.what()).find(name), std::string::npos) << error.what();
          ++num_refused;
        }
      }
    }
  }
  EXPECT_GT(num_refused, 10 * num_accepted);
}

TEST(SurfaceVariants, WithDamagedBytesTheyNeverCrash) {
  const SurfaceFiles files;
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  std::mt19937 random(seed);
  std::size_t num_refused = 0;
  for (const auto& [name, content] : surface_variants()) {
    for (const std::string& whole : {content, packed(content)}) {
      for (int i = 0; i < 8; ++i) {
        std::string damaged = whole;
        for (auto n = 1 + random() % 4; n > 0; --n)
          damaged[random() % damaged.size()] = static_cast<char>(random() % 256);
        try {
          expect_closed(files.read(name, damaged));
        } catch (const InputError& error) {
          EXPECT_NE(std::string(error.what()).find(name), std::string::npos) << error.what();
          ++num_refused;
        }
      }
    }
  }
  EXPECT_GT(num_refused, 500u);
}

TEST(SurfaceVariants, TextIsNeverTakenForABinaryFileThatIsCutOff) {
  const SurfaceFiles files;
  const unsigned seed = std::random_device()();
  SCOPED_TRACE(testing::Message() << "seed " << seed);
  std::mt19937 random(seed);
  const std::string plain = to_stl({});
  for (int i = 0; i < 500; ++i) {
    std::string text = i == 0 ? std::string(300, 'x') : plain;
    for (auto n = random() % 40; n > 0; --n)
      text[random() % text.size()] = static_cast<char>(' ' + random() % 222);
    if (random() % 4 == 0) text.resize(random() % text.size());
    if (text.empty()) continue;
    const std::string message = refusal(files, "text.stl", text);
    EXPECT_EQ(message.find("promises"), std::string::npos) << message;
    EXPECT_EQ(message.find("84 bytes"), std::string::npos) << message;
  }
  expect_refused(refusal(files, "prose.stl", std::string(300, 'x')), {"text", "no ASCII STL"});
}

TEST(SurfaceVariants, WhatIsOddIsNoted) {
  const SurfaceFiles files;
  const auto notes = [&](const std::string& name, std::string_view content) {
    return fmt::format("{}", fmt::join(files.read(name, content).facts.notes, "\n"));
  };
  for (const auto& [name, content] : surface_variants()) {
    SCOPED_TRACE(name);
    const std::string text = notes(name, content);
    const bool is_odd = name == "without_end.stl" || name == "trailing_bytes.stl" ||
                        name == "sectors.stl" || name.starts_with("count_") ||
                        name == "materials_within.obj";
    EXPECT_EQ(!text.empty(), is_odd) << text;
  }
  EXPECT_NE(notes("a.stl", to_stl({.end_solid = ""})).find("endsolid"), std::string::npos);
  const std::string binary = to_binary_stl(variant_box());
  EXPECT_NE(notes("b.stl", binary + "xyz").find("last 3 bytes"), std::string::npos);
  EXPECT_NE(notes("c.obj", to_obj(ObjStyle{.before = "Ka 1 1 1\nKd 1 1 1\n"}))
                .find("2 lines whose first word OBJ does not know, as \"Ka\" in line 1"),
            std::string::npos);
}

TEST(SurfaceVariants, StripsOfTrianglesTurnAtEveryOther) {
  // 0 1 2 3 4 as a strip, a strip that turns around by a repeated corner, and one too short.
  const std::string ply =
      "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float "
      "z\nelement tristrips 1\nproperty list int int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 "
      "0\n0 0 1\n1 1 1\n15 0 1 2 3 4 -1 0 1 1 2 3 -1 3 4 -1\n";
  struct Faces : SurfaceSink {
    void vertex(const Point&) override {}
    void polygon(std::span<const std::uint64_t> corners, const FilePlace&) override {
      faces.emplace_back(corners.begin(), corners.end());
    }
    void facet(const std::array<Point, 3>&) override { FAIL(); }
    std::vector<std::vector<std::uint64_t>> faces;
  } sink;
  const SurfaceFiles files;
  parse_surface(files.write("strips.ply", ply), sink);
  EXPECT_EQ(sink.faces,
            (std::vector<std::vector<std::uint64_t>>{{0, 1, 2}, {2, 1, 3}, {2, 3, 4}, {1, 2, 3}}));
  expect_refused(refusal(files, "beyond.ply", replaced(ply, "-1 0 1 1", "-1 0 9 1")),
                 {"vertex 9", "only 5"});
  expect_refused(refusal(files, "cut.ply", ply.substr(0, ply.size() - 6)), {"cut off"});
}

TEST(SurfaceVariants, WhatIsToBeConvertedIsRefusedWithTheCure) {
  const SurfaceFiles files;
  const std::string stl = to_stl({});
  std::string little, big;
  for (const char c : stl) little += {c, '\0'}, big += {'\0', c};
  struct Row {
    std::string name, content;
    std::vector<std::string> parts;
  };
  using namespace std::string_literals;
  const std::vector<Row> table = {
      {"a.stl", "\xff\xfe" + little, {"UTF-16", "iconv -f UTF-16 -t UTF-8"}},
      {"a.stl", "\xfe\xff" + big, {"UTF-16", "iconv"}},
      {"a.stl", little, {"UTF-16LE", "iconv -f UTF-16LE"}},
      {"a.obj", big, {"UTF-16BE", "iconv -f UTF-16BE"}},
      {"a.off", "\xff\xfe\0\0O\0\0\0"s, {"UTF-32"}},
      {"a.stl.zip", "PK\3\4" + stl, {"zip archive", "unzip"}},
      {"a.stl", "PK\3\4" + stl, {"zip archive", "unzip"}},
      {"a.stl.xz", "\xfd\x37zXZ\0"s + stl, {"xz -dk"}},
      {"a.stl.bz2", "BZh91AY&SY" + stl, {"bzip2 -dk"}},
      {"a.stl.zst", "\x28\xb5\x2f\xfd" + stl, {"zstd -d"}},
      {"a.stl.gz", packed(packed(stl)), {"gzip twice", "gzip -dk"}},
      {"a.tar.gz", packed(std::string(257, 'a') + "ustar" + std::string(250, '\0')), {"tar -xf"}},
  };
  for (const auto& [name, content, parts] : table) {
    SCOPED_TRACE(parts.front());
    expect_refused(refusal(files, name, content), parts);
  }
}

// ---- What gzip has packed

TEST(PackedSurfaces, AreReadAlikeHoweverTheyAreNamed) {
  const SurfaceFiles files;
  const Corners expected = corners_of_box();
  for (const auto& [name, content] : surface_variants()) {
    SCOPED_TRACE(name);
    for (const std::string& packed_name : {name + ".gz", name, std::string("surface")}) {
      if (packed_name == "surface" && needs_its_name(name)) continue;
      EXPECT_EQ(files.read(packed_name, packed(content)).corners(), expected) << packed_name;
    }
    EXPECT_EQ(files.read(name + ".gz", content).corners(), expected) << "not packed at all";
    const std::size_t half = content.size() / 2;
    const std::string members = packed(content.substr(0, half)) + packed("") +
                                packed(content.substr(half), Z_NO_COMPRESSION);
    EXPECT_EQ(files.read(name + ".gz", members).corners(), expected);
    EXPECT_EQ(files.read(name + ".gz", members + std::string(512, '\0')).corners(), expected);
  }
}

// One that was packed meanwhile goes on with the same run.
TEST(PackedSurfaces, HaveTheDigestOfWhatTheyHold) {
  const SurfaceFiles files;
  const auto plain = files.write("a.stl", to_stl({}));
  const auto gz = files.write("a.stl.gz", packed(to_stl({})));
  EXPECT_EQ(digest_of_file(gz), digest_of_file(plain));
  EXPECT_EQ(surface_in_file(gz, files.directory()).digest(nullptr), digest_of_file(plain));
  EXPECT_EQ(read_whole_surface(gz).digest, digest_of_file(plain));
}

TEST(PackedSurfaces, LargeOnesAreUnpackedAsTheyAreRead) {
  Polygons boxes;
  for (int i = 0; i < 1000; ++i)
    boxes.append(box_of_triangles({2.0 * i, 0, 0}, {2.0 * i + 1 + 1.0 / (i + 3), 1, 1}));
  const SurfaceFiles files;
  for (const auto& [name, content] : in_every_format(boxes)) {
    if (name.ends_with(".3mf")) continue;  // packed by itself
    SCOPED_TRACE(name);
    const InputSurface expected = files.read(name, content);
    const InputSurface s = files.read(name + ".gz", packed(content));
    EXPECT_EQ(s.corners(), expected.corners());
    EXPECT_EQ(s.digest, expected.digest);
  }
}

TEST(PackedSurfaces, DamageIsTold) {
  const SurfaceFiles files;
  const std::string good = packed(to_stl({}));
  expect_refused(refusal(files, "a.stl.gz", good.substr(0, good.size() / 2)), {"cut off", "gzip"});
  expect_refused(refusal(files, "a.stl.gz", good.substr(0, good.size() - 1)), {"cut off", "gzip"});
  expect_refused(refusal(files, "a.stl.gz", good.substr(0, 5)), {"cut off", "gzip"});
  expect_refused(refusal(files, "a.stl.gz", good + "more"), {"goes on", "gzip"});
  expect_refused(refusal(files, "a.stl.gz", good + good.substr(0, 20)), {"cut off", "gzip"});
  std::string checksum = good;
  checksum[checksum.size() - 6] = static_cast<char>(checksum[checksum.size() - 6] ^ 1);
  expect_refused(refusal(files, "a.stl.gz", checksum), {"damaged", "data check"});
  std::string middle = good;
  for (std::size_t i = middle.size() / 2; i < middle.size() / 2 + 20; ++i) middle[i] = '\xff';
  expect_refused(refusal(files, "a.stl.gz", middle), {"damaged", "gzip"});
  expect_refused(refusal(files, "a.stl.gz", packed("")), {"empty"});
  expect_refused(refusal(files, "a.ply.gz", packed(to_stl({}))), {"named .ply", "rename"});
}

// ---- What comes through a pipe

// Writes into a pipe, in pieces, from another thread.
class PipeWriter {
 public:
  PipeWriter(const std::filesystem::path& pipe, std::string content, int delay_milliseconds = 0)
      : writer_([pipe, content = std::move(content), delay_milliseconds] {
          const int out = ::open(pipe.c_str(), O_WRONLY | O_CLOEXEC);
          std::string_view rest = content;
          while (!rest.empty()) {
            const ssize_t n = ::write(out, rest.data(), std::min<std::size_t>(rest.size(), 700));
            if (n <= 0) break;
            rest.remove_prefix(static_cast<std::size_t>(n));
            std::this_thread::sleep_for(std::chrono::milliseconds(delay_milliseconds));
          }
          ::close(out);
        }) {}
  ~PipeWriter() { writer_.join(); }

 private:
  std::thread writer_;
};

std::filesystem::path make_pipe(const SurfaceFiles& files, const std::string& name) {
  const auto pipe = files.directory() / name;
  if (mkfifo(pipe.c_str(), 0600) != 0) throw std::runtime_error("mkfifo");
  return pipe;
}

TEST(PipedSurfaces, AreReadAlikeAndAsOftenAsNeeded) {
  const SurfaceFiles files;
  const Corners expected = corners_of_box();
  const auto pipe = make_pipe(files, "surface");  // without an extension: the content decides
  IngestWatch watch;
  for (const auto& [name, content] : surface_variants()) {
    if (needs_its_name(name)) continue;
    SCOPED_TRACE(name);
    for (const std::string& written : {content, packed(content)}) {
      const PipeWriter writer(pipe, written);
      const SurfaceSource source = surface_in_file(pipe, files.directory());
      const std::string digest = source.digest(nullptr);
      for (int again = 0; again < 2; ++again) {
        const RawSurface raw = read_surface(source, files.directory(), watch);
        Corners corners;
        raw.spill.for_each(raw.triangles.front(),
                           [&](const Triangle& t) { corners.push_back(t.corners); });
        EXPECT_EQ(corners, expected);
        EXPECT_EQ(raw.digest, digest);
      }
      EXPECT_EQ(digest, digest_of_file(files.write("copy", content)));
    }
  }
  // Its copy had no name, and is gone.
  for (const auto& entry : std::filesystem::directory_iterator(files.directory()))
    EXPECT_FALSE(entry.path().filename().string().starts_with("locvol-")) << entry.path();
}

TEST(PipedSurfaces, AreRefusedByTheNameOfThePipe) {
  const SurfaceFiles files;
  const auto pipe = make_pipe(files, "pipe.stl");
  const auto message = [&](const std::string& content) -> std::string {
    const PipeWriter writer(pipe, content);
    try {
      read_whole_surface(pipe);
    } catch (const InputError& error) {
      return error.what();
    }
    return {};
  };
  expect_refused(message(""), {pipe.string(), "empty"});
  expect_refused(message(to_stl({}).substr(0, 500)), {pipe.string(), "inside a facet"});
  expect_refused(message(to_binary_stl(variant_box()).substr(0, 300)), {pipe.string(), "promises"});
  expect_refused(message(packed(to_stl({})).substr(0, 100)), {pipe.string(), "cut off"});
}

TEST(PipedSurfaces, AStopEndsTheWait) {
  const SurfaceFiles files;
  const auto pipe = make_pipe(files, "pipe.stl");
  std::atomic<bool> is_stopped = false;
  const StopSource stop([&] { return is_stopped.load(); });
  std::thread stopper([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    is_stopped = true;
  });
  const auto start = std::chrono::steady_clock::now();
  EXPECT_THROW(surface_in_file(pipe, files.directory()).digest(&stop), Stopped);  // nobody writes
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(2));
  stopper.join();
}

TEST(PipedSurfaces, ADiskThatIsFullIsTold) {
  const SurfaceFiles files;
  const auto pipe = make_pipe(files, "pipe.stl");
  const auto ignored = std::signal(SIGPIPE, SIG_IGN);
  {
    const FileSizeLimit limit(1000);
    const PipeWriter writer(pipe, to_stl({}));
    EXPECT_THROW(surface_in_file(pipe, files.directory()).digest(nullptr), std::system_error);
  }
  std::signal(SIGPIPE, ignored);
}

// The standard input of this process while the object lives.
class RedirectedInput {
 public:
  explicit RedirectedInput(const std::filesystem::path& file)
      : before_(::fcntl(STDIN_FILENO, F_DUPFD_CLOEXEC, 3)) {
    const int descriptor = ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
    ::dup2(descriptor, STDIN_FILENO);
    ::close(descriptor);
  }
  ~RedirectedInput() {
    ::dup2(before_, STDIN_FILENO);
    ::close(before_);
  }

 private:
  int before_;
};

TEST(PipedSurfaces, TheStandardInputIsReadFromWhereItStands) {
  const SurfaceFiles files;
  const std::string before = "a line for another program\n";
  const RedirectedInput input(files.write("input", before + to_stl({})));
  ASSERT_EQ(::lseek(STDIN_FILENO, static_cast<off_t>(before.size()), SEEK_SET),
            static_cast<off_t>(before.size()));
  IngestWatch watch;
  const SurfaceSource source = surface_in_standard_input(files.directory());
  for (int again = 0; again < 2; ++again) {
    const RawSurface raw = read_surface(source, files.directory(), watch);
    EXPECT_EQ(raw.num_triangles(), 12u);
    EXPECT_EQ(raw.digest, digest_of_file(files.write("only.stl", to_stl({}))));
  }
}

TEST(PipedSurfaces, AnIngestThatEndedGoesOnWhenItIsGivenAgain) {
  const SurfaceFiles files;
  MeshOptions options;
  options.input = kFromStandardInput;
  options.store = files.directory() / "store";
  options.size = {0.4, false};
  const auto surface = files.write("surface", to_stl({}));
  {
    const RedirectedInput input(surface);
    bool is_stopped = false;
    RunControl control;
    control.on_run = [&](const RunRecord& run) {
      EXPECT_EQ(run.surface.file, kStandardInput);
      is_stopped = true;
      std::this_thread::sleep_for(2 * StopSource::kInterval);  // so that it is asked before the end
    };
    control.is_stopped = [&] { return is_stopped; };
    ASSERT_EQ(mesh(options, control).run.phase, Phase::kIngest);
  }
  {
    const RedirectedInput input(files.write("other", to_stl({}) + "\n"));
    EXPECT_THROW(resume(options.store), StoreMismatch);
  }
  {
    const RedirectedInput input("/dev/null");
    EXPECT_THROW(resume(options.store), InputError);
  }
  const RedirectedInput input(surface);
  EXPECT_EQ(resume(options.store).outcome, RunOutcome::kDone);
}

TEST(PipedSurfaces, AreReadByTheFirstOfSeveralRanks) {
  const SurfaceFiles files;
  MeshOptions options;
  options.input = files.write("a.stl", to_binary_stl(variant_box()));
  options.store = files.directory() / "one";
  options.size = {0.4, false};
  mesh(options);
  const auto pipe = make_pipe(files, "pipe.stl");
  const std::string gz = packed(to_binary_stl(variant_box()));
  for (const std::filesystem::path& file : {pipe, files.write("a.stl.gz", gz)}) {
    SCOPED_TRACE(file);
    std::optional<PipeWriter> writer;
    if (file == pipe) writer.emplace(pipe, gz);
    MeshOptions many = options;
    many.input = file;
    many.store = files.directory() / (file.filename().string() + "-%r");
    run_as_ranks(3, [&](Exchange& exchange) {
      const RunSummary summary = mesh_as_rank(many, {}, exchange);
      EXPECT_EQ(summary.run.counts.num_cells,
                Store::open(options.store, {.read_only = true}).snapshot().run()->counts.num_cells);
      EXPECT_EQ(summary.run.parameters,
                Store::open(options.store, {.read_only = true}).snapshot().run()->parameters);
    });
  }
}

TEST(PipedSurfaces, ADeviceIsNoFile) {
  const SurfaceFiles files;
  for (const char* device : {"/dev/null", "/dev/zero"}) {
    try {
      surface_in_file(device, files.directory()).digest(nullptr);
      ADD_FAILURE() << device;
    } catch (const InputError& error) {
      expect_refused(error.what(), {device, "device"});
    }
  }
}

// ---- What users have sent

TEST(ReportedSurfaces, AreRead) {
  const std::filesystem::path models = models_directory();
  if (models.empty() || !std::filesystem::exists(models / "reports")) GTEST_SKIP() << kNoModels;
  for (const char* name : {"upper.stl", "bom.stl", "end_loop.stl", "cube3solids.stl"}) {
    SCOPED_TRACE(name);
    const InputSurface s = read_whole_surface(models / "reports" / name);
    EXPECT_EQ(s.facts.num_triangles, 12u);
    EXPECT_DOUBLE_EQ(s.facts.volume, 1);
  }
}

}  // namespace
}  // namespace locvol
