// A stage whose visits are apply(compute(load(leaf))). What they find is a value, which is sent to
// other ranks as its fields are (refine/leaf_fields.h).
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "engine/exchange/pack.h"
#include "engine/run/surroundings.h"
#include "engine/stages/stages.h"

namespace locvol {

template <class Input, class Result>
class VisitingStage : public LeafStage, public LeafVisits {
 public:
  explicit VisitingStage(const StageTools& tools)
      : tools_(tools), state_(tools.state), around_(tools.state, &tools.stop) {}

  LeafVisits* visits() final { return this; }
  std::unique_ptr<Visit> load(MortonKey leaf) final {
    return std::make_unique<Made>(*this, leaf, load_input(leaf));
  }
  void apply(MortonKey leaf, std::string_view result) final {
    apply_result(leaf, unpack<Result>(result));
  }

 protected:
  virtual Loaded<Input> load_input(MortonKey leaf) = 0;
  virtual Result compute(Input&& input) const = 0;  // by any thread
  virtual void apply_result(MortonKey leaf, const Result& result) = 0;
  // Without what only the visited leaf's own rank keeps; with what only it may know.
  virtual std::string for_others(const Result& result) const { return pack(result); }

  StageTools tools_;
  RunState& state_;
  Surroundings around_;

 private:
  class Made : public Visit {
   public:
    Made(VisitingStage& stage, MortonKey leaf, Loaded<Input> loaded)
        : stage_(stage), leaf_(leaf), bytes_(loaded.bytes), input_(std::move(loaded.input)) {}
    std::uint64_t bytes() const override { return bytes_; }
    void compute() override {
      result_ = stage_.compute(std::move(*input_));
      input_.reset();
    }
    void apply() override { stage_.apply_result(leaf_, *result_); }
    std::string result() const override { return pack(*result_); }
    std::string result_for_others() const override { return stage_.for_others(*result_); }

   private:
    VisitingStage& stage_;
    MortonKey leaf_;
    std::uint64_t bytes_;
    std::optional<Input> input_;
    std::optional<Result> result_;
  };
};

}  // namespace locvol
