// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "apps/run_binary.hpp"
#include "support/recordings.hpp"

namespace rangecal::test {
namespace {

using ::testing::HasSubstr;
using testing::recordings;

TEST(CompareCommand, FourMethodsInOneTableAndOneSentence) {
  const RunResult result = run("compare " + shipped("field-layout"));
  ASSERT_EQ(result.code, 0) << result.err;
  for (const char* part : {"closed-form", "approximate", "full *", "marginal", "alpha_2 [1/m]",
                           "sigma_e [1/m]", "sigma_theta [deg]", "joint NLL", "marginal NLL", "AIC",
                           "time [ms]", "landmark RMSE [mm]", "MSE ratio", "* optimistic",
                           "marginal: Cramer-Rao bound of alpha (standard deviations) at the estimate: ",
                           "marginal: the same at the true stops and landmarks", "Trust marginal: "})
    EXPECT_THAT(result.out, HasSubstr(part));
  EXPECT_EQ(count_of(result.out, "Trust "), 1);
  // The recording was simulated by the seed model, so nothing speaks against the fit.
  EXPECT_THAT(result.out, ::testing::Not(HasSubstr("BUT")));
}

TEST(CompareCommand, PairsHaveNoLandmarks) {
  const RunResult result = run("compare " + shipped("pairs-2016"));
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("MSE ratio"));
  EXPECT_THAT(result.out, ::testing::Not(HasSubstr("landmark RMSE")));
}

TEST(CompareCommand, SeveralRecordingsShareOneSensor) {
  const RunResult result =
      run("compare " + shipped("field-layout") + " " + shipped("2021-setting") + " --order 2 --noise f2");
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("2 recordings"));
  EXPECT_THAT(result.out, HasSubstr("600 readings"));
}

TEST(CompareCommand, CurvesOnThePageHaveBandsOfOneKind) {
  const TemporaryFolder folder;
  const std::string html = folder.file("page.html");
  const RunResult result = run("compare " + shipped("field-layout") + " --report " + html);
  if (result.err.find("no charting library") != std::string::npos) GTEST_SKIP() << result.err;
  ASSERT_EQ(result.code, 0) << result.err;
  // Of landmarks, marginal alone knows the band with the choice; of pairs every method does.
  EXPECT_THAT(slurp(html), HasSubstr(" band, given this order and noise law,"));
  ASSERT_EQ(run("compare " + shipped("pairs-2016") + " --report " + html).code, 0);
  EXPECT_THAT(slurp(html), HasSubstr(" band, the choice of order and noise law in it,"));
}

class RealRecording : public ::testing::TestWithParam<const char*> {};

TEST_P(RealRecording, EndsInAConvergedFullLikelihood) {
  const std::string folder = recordings() + "/rangecal/" + GetParam();
  RANGECAL_REQUIRE_RECORDING(folder);
  const RunResult result = run("calibrate " + folder + " --method full --order 2");
  EXPECT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("converged by full"));
}

TEST(CompareCommand, SpuriousJointMaximumIsNotCalledConverged) {
  // Stops of three coordinates each see three landmarks or so: sigma_theta of full falls to a third of marginal's.
  const std::string folder = recordings() + "/rangecal/brenner-lego";
  RANGECAL_REQUIRE_RECORDING(folder);
  const RunResult result = run("calibrate " + folder + " --method full --order 2");
  EXPECT_EQ(result.code, 1) << result.err;
  EXPECT_THAT(result.out, HasSubstr("UNBOUNDED"));
  EXPECT_THAT(result.out, HasSubstr("no maximum of use"));
}

INSTANTIATE_TEST_SUITE_P(All, RealRecording,
                         ::testing::Values("mrclam6-robot3", "mrclam6-robot1-pairs",
                                           "wall-sonar-calibration"),
                         [](const auto& one) {
                           std::string name = one.param;
                           for (char& c : name)
                             if (c == '-') c = '_';
                           return name;
                         });

}  // namespace
}  // namespace rangecal::test
