// The module's one entry. Here exceptions end, and become what the engine is told.
#include <new>

#include "cad/shape_file.h"
#include "cad/triangulator.h"

namespace locvol::cad {
namespace {

template <class Work>
CadResult guarded(const Work& work) {
  using Kind = CadResult::Kind;
  try {
    work();
    return {};
  } catch (const Refusal& refusal) {
    return {Kind::kRefused, refusal.what()};
  } catch (const Ended&) {
    return {Kind::kStopped};
  } catch (const std::bad_alloc&) {
    return {Kind::kOutOfMemory};
  } catch (const Standard_Failure& failure) {
    return {Kind::kRefused, std::string("cannot be read by OpenCASCADE (") +
                                failure.DynamicType()->Name() + ": " + failure.GetMessageString() +
                                "): it is damaged; fetch or export it again"};
  } catch (const std::exception& error) {
    return {Kind::kRefused, std::string("cannot be read by OpenCASCADE (") + error.what() +
                                "): it is damaged; fetch or export it again"};
  }
}

class Model : public CadModel {
 public:
  Model(ShapeFile shapes, CadWatch& watch) : shapes_(std::move(shapes)) {
    measure(shapes_, facts_, watch);
  }
  const CadFacts& facts() const override { return facts_; }
  CadResult triangulate(const CadLaw& law, CadSink& sink) override {
    return guarded([&] { cad::triangulate(shapes_, law, sink); });
  }

 private:
  ShapeFile shapes_;
  CadFacts facts_;
};

CadResult read(const char* file, CadFormat format, CadWatch& watch,
               std::unique_ptr<CadModel>& model) {
  return guarded([&] { model = std::make_unique<Model>(read_shapes(file, format, watch), watch); });
}

}  // namespace
}  // namespace locvol::cad

extern "C" __attribute__((visibility("default"))) const locvol::CadModule* locvol_cad_module() {
  static const locvol::CadModule module{locvol::kCadVersion, locvol::cad::read};
  return &module;
}
