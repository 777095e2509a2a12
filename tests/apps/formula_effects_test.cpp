// SPDX-License-Identifier: BSD-3-Clause
// Effects by formula on the command line: asked for, planted, named and undone as those of the catalogue.
#include <fmt/core.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <regex>
#include <sstream>
#include <string>
#include <utility>

#include "apps/run_binary.hpp"
#include "rangecal/core/random.hpp"

namespace rangecal::test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using Json = nlohmann::json;

const std::string ours = " --effects " + shipped("effects-by-formula");

class FormulaEffects : public ::testing::Test {
 protected:
  /// A recording whose bearings are off by 0.02 rad twelve times a turn.
  std::string rippled() {
    folder.write(
        "scene.yaml",
        "format: rangecal-scene/1\n"
        "sensor: {alpha: [0.05, 0.9, 0.05], noise: {law: f2, sigma: 0.004}, sigma_theta_rad: 0.005}\n"
        "stops: {line: {count: 24, start_m: [0, 0], step_m: 0.2, direction_rad: 0}, sigma_xy_m: 0.01}\n"
        "landmarks: {list: [{landmark: A, x_m: 1, y_m: 1.5}, {landmark: B, x_m: 3, y_m: -1.2},\n"
        "  {landmark: C, x_m: 2.2, y_m: 2.1}, {landmark: D, x_m: 4.1, y_m: 1.4}]}\n"
        "repeats: 6\n"
        "effects: {gear_ripple: {a_rad: 0.016, c_rad: -0.012, n: 12}}\n");
    const RunResult made =
        run("simulate " + folder.file("scene.yaml") + " -o " + folder.file("rec") + " --seed 3" + ours);
    EXPECT_EQ(made.code, 0) << made.err;
    return folder.file("rec");
  }
  Json diagnosed(const std::string& rec, const std::string& options) {
    const RunResult result = run("diagnose " + rec + " --json " + folder.file("d.json") + " --calibration " +
                                 folder.file("cal.json") + options);
    EXPECT_EQ(result.code, 0) << result.err;
    return Json::parse(slurp(folder.file("d.json")));
  }
  TemporaryFolder folder;
};

TEST_F(FormulaEffects, ParametersArePrintedInTheirUnits) {
  folder.write("cone.yaml",
               "effect: cone\nphysics: p\nsettled_by: s\nchannel: range\nformula: a*b + c*b^2 + k*d^2\n"
               "parameters:\n  a: {unit: m/rad, typical: 0.01, from: -1, to: 1}\n"
               "  c: {unit: m/rad^2, typical: 0.01, from: -1, to: 1}\n"
               "  k: {unit: 1/m, typical: 0.01, from: -1, to: 1}\n");
  const RunResult result =
      run("diagnose " + shipped("concealed/world-11") + " --effects " + folder.path() + " --force cone");
  ASSERT_EQ(result.code, 0) << result.err;
  for (const char* line :
       {R"(cone\.a +\S.* mm/rad\n)", R"(cone\.c +\S.* mm/rad\^2\n)", R"(cone\.k +\S.* 1/m\n)"})
    EXPECT_TRUE(std::regex_search(result.out, std::regex(line))) << line << "\n" << result.out;
}

TEST_F(FormulaEffects, ARippleIsNamedWithItsNumberOfTeethAndUndone) {
  const std::string rec = rippled();
  const Json d = diagnosed(rec, ours);
  EXPECT_EQ(d.at("verdict"), "explained");
  EXPECT_EQ(d.at("final").at("effects"), Json::array({"gear_ripple"}));
  const Json& parameters = d.at("explanations").at(0).at("parameters");
  EXPECT_EQ(parameters.at("gear_ripple.n").at("estimate"), 12.0);
  for (const auto& [name, truth] : {std::pair{"a_rad", 0.016}, {"c_rad", -0.012}}) {
    const Json& one = parameters.at(std::string("gear_ripple.") + name);
    EXPECT_NEAR(one.at("estimate").get<double>(), truth, 4.0 * one.at("std").get<double>()) << name;
  }

  // Undone where the effect is known, refused where it is not.
  const std::string readings = "range_m,bearing_rad\n2,0.4\n";
  EXPECT_EQ(run("correct " + folder.file("cal.json") + ours, readings).code, 0);
  const RunResult unknown = run("correct " + folder.file("cal.json"), readings);
  EXPECT_EQ(unknown.code, 2);
  EXPECT_THAT(unknown.err, HasSubstr("gear_ripple"));
}

// y = d + 0.03 t / duration with noise of 2 mm; the size that a formula says is typical may be of either sign.
TEST_F(FormulaEffects, TimeInDurationsIsFittedAndUndoneWhateverTheSignOfItsTypicalSize) {
  std::filesystem::create_directory(folder.file("rec"));
  folder.write("rec/recording.yaml", "format: rangecal/1\nkind: pairs\nsensor: {range_min_m: 0}\n");
  Random random(seed_from("FormulaEffects durations"));
  std::string pairs = "true_m,reading_m,time_s\n";
  for (int i = 0; i <= 400; ++i) {
    const double d = random.uniform(0.5, 4.0);
    pairs += fmt::format("{:.6f},{:.6f},{}\n", d, d + 0.03 * i / 400.0 + random.normal(0.0, 0.002), 2 * i);
  }
  folder.write("rec/pairs.csv", pairs);
  for (const std::string typical : {"0.02", "-0.02"}) {
    std::filesystem::create_directory(folder.file("fx"));
    folder.write("fx/creep.yaml",
                 "effect: creep\nphysics: p\nsettled_by: s\nchannel: range\nformula: a*t/duration\n"
                 "parameters: {a: {unit: m, typical: " +
                     typical + ", from: -0.5, to: 0.5}}\n");
    const std::string with = " --effects " + folder.file("fx");
    const Json d = diagnosed(folder.file("rec"), " --force creep" + with);
    const Json& a = d.at("explanations").at(0).at("parameters").at("creep.a_m");
    // 2 mm over sqrt(401 / 12), curve and slope in time being orthogonal: 0.35 mm.
    EXPECT_NEAR(a.at("estimate").get<double>(), 0.03, 4.0 * 0.35e-3) << typical;
    EXPECT_NEAR(a.at("std").get<double>(), 0.35e-3, 0.05e-3) << typical;
    const RunResult undone =
        run("correct " + folder.file("cal.json") + with, "range_m,time_s\n2.0,0\n2.03,800\n");
    ASSERT_EQ(undone.code, 0) << undone.err;
    std::istringstream lines(undone.out);
    std::string line;
    std::getline(lines, line);
    for (int row = 0; row < 2; ++row) {
      ASSERT_TRUE(std::getline(lines, line));
      EXPECT_NEAR(std::stod(line.substr(line.find(',') + 1)), 2.0, 0.003) << line;
    }
    const RunResult timeless = run("correct " + folder.file("cal.json") + with, "range_m\n2.0\n");
    EXPECT_EQ(timeless.code, 2);
    EXPECT_THAT(timeless.err, AllOf(HasSubstr("time_s"), HasSubstr("creep")));
  }
}

TEST_F(FormulaEffects, ACleanRecordingStaysClean) {
  EXPECT_EQ(diagnosed(shipped("field-layout"), ours).at("verdict"), "no_mismatch");
}

TEST_F(FormulaEffects, WhatCannotBeUsedIsOneLineAndExitCode2) {
  const auto with = [&](const std::string& yaml) {
    std::filesystem::create_directory(folder.file("bad"));
    folder.write("bad/bad.yaml", yaml);
    return run("diagnose " + shipped("field-layout") + " --effects " + folder.file("bad"));
  };
  const std::string head =
      "effect: bad\nphysics: p\nsettled_by: s\nchannel: range\nparameters: {a: {unit: m, typical: 1, from: 0, to: 2}}\n";
  for (const std::string& formula :
       {std::string(100000, '('), std::string("a/(b-b)"), std::string("a*nowhere"), std::string("a+"),
        std::string("sqrt(-a)"), std::string("'nan'")}) {
    const RunResult result = with(head + "formula: \"" + formula + "\"\n");
    EXPECT_EQ(result.code, 2) << formula.substr(0, 20);
    EXPECT_EQ(count_of(result.err, "\n"), 1) << result.err;
    EXPECT_EQ(result.out, "");
  }
  EXPECT_EQ(run("diagnose " + shipped("field-layout") + " --effects /nowhere").code, 2);
}

TEST_F(FormulaEffects, OneOfTheCatalogueIsPrintedToCopy) {
  const RunResult yaml = run("effects cyclic_error --as-yaml");
  EXPECT_EQ(yaml.code, 0);
  EXPECT_THAT(yaml.out, AllOf(HasSubstr("effect: my_cyclic_error\n"), HasSubstr("channel: range\n"),
                              HasSubstr("wavenumber: {unit: \"1/m\"")));
  std::filesystem::create_directory(folder.file("copied"));
  folder.write("copied/one.yaml", yaml.out);
  EXPECT_THAT(run("effects my_cyclic_error --effects " + folder.file("copied")).out, HasSubstr("parameter"));
  const RunResult none = run("effects label_swap --as-yaml");
  EXPECT_EQ(none.code, 2);
  EXPECT_THAT(none.err, AllOf(HasSubstr("is no formula of one reading"), HasSubstr("cyclic_error")));
}

TEST_F(FormulaEffects, TheExampleOfTheDocumentationIsOne) {
  const std::string page = slurp(std::string(RANGECAL_SOURCE_DIR) + "/docs/effects-by-formula.md");
  std::filesystem::create_directory(folder.file("docs"));
  int examples = 0;
  for (std::size_t at = page.find("```yaml\n"); at != std::string::npos;
       at = page.find("```yaml\n", at + 1)) {
    const std::size_t begin = at + 8;
    folder.write("docs/" + std::to_string(++examples) + ".yaml",
                 page.substr(begin, page.find("```", begin) - begin));
  }
  EXPECT_EQ(examples, 2);
  EXPECT_EQ(run("effects dusty_window --effects " + folder.file("docs")).code, 0);
}

}  // namespace
}  // namespace rangecal::test
