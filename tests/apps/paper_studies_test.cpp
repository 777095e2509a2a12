// SPDX-License-Identifier: BSD-3-Clause
// The studies behind docs/reproduction.md, reduced to 20 repeats a point, against the results that ship with them.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <regex>
#include <string>

#include "apps/run_binary.hpp"
#include "rangecal/core/csv_table.hpp"

namespace {

using rangecal::CsvTable;
using rangecal::test::run;
using rangecal::test::RunResult;
using rangecal::test::slurp;
using rangecal::test::TemporaryFolder;

const std::filesystem::path studies =
    std::filesystem::path(RANGECAL_SOURCE_DIR) / "notebooks_data" / "studies";

/// What comes before the column `repeats`: point, parameters and estimator.
std::string place(const CsvTable& table, std::size_t row) {
  std::string text;
  for (std::size_t c = 0; c < table.require("repeats"); ++c) text += std::string(table.text(row, c)) + ",";
  return text;
}

class PaperStudy : public ::testing::TestWithParam<std::string> {};

/// Same points, estimators and columns; RMSE within eight of the reduced run's own standard errors and half of the
/// value (20 repeats: the error of an RMSE is 16 % for one dimension, and its own estimate is as uncertain).
TEST_P(PaperStudy, ReducedFormAgreesWithItsResults) {
  const TemporaryFolder folder;
  std::filesystem::create_directory(folder.file("studies"));
  std::filesystem::create_directory_symlink(studies / "scenes", folder.file("studies/scenes"));
  std::filesystem::create_directory_symlink(studies.parent_path() / "scenes", folder.file("scenes"));
  const std::string text = slurp((studies / (GetParam() + ".yaml")).string());
  folder.write("studies/study.yaml",
               std::regex_replace(text, std::regex("\nrepeats: [0-9]+"), "\nrepeats: 20"));
  const RunResult result = run("study " + folder.file("studies/study.yaml") + " -o " + folder.file("out"));
  ASSERT_EQ(result.code, 0) << result.err;

  const CsvTable reduced = CsvTable::read(folder.file("out/results.csv")),
                 whole = CsvTable::read((studies / "results" / (GetParam() + ".csv")).string());
  ASSERT_EQ(reduced.columns(), whole.columns());
  ASSERT_EQ(reduced.rows(), whole.rows());
  int compared = 0;
  for (std::size_t r = 0; r < whole.rows(); ++r) {
    ASSERT_EQ(place(reduced, r), place(whole, r));
    if (reduced.count(r, reduced.require("answers")) < 18) continue;
    for (const char* name : {"landmark_rmse", "curve_rmse"}) {
      const auto column = reduced.find(std::string(name) + "_m"),
                 error = reduced.find(std::string(name) + "_se_m");
      if (!column) continue;
      const auto few = reduced.number(r, *column), many = whole.number(r, *column),
                 se = reduced.number(r, *error);
      if (!few || !many || !se) continue;
      EXPECT_LE(std::abs(*few - *many), 8.0 * *se + 0.5 * *many) << place(whole, r) << name;
      ++compared;
    }
  }
  if (reduced.find("curve_rmse_m")) {
    EXPECT_GT(compared, static_cast<int>(whole.rows()) / 2);
  }
}

std::vector<std::string> with_results() {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(studies / "results"))
    names.push_back(entry.path().stem().string());
  std::sort(names.begin(), names.end());
  return names;
}

std::string test_name(const ::testing::TestParamInfo<std::string>& study) {
  std::string name = study.param;
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
}

INSTANTIATE_TEST_SUITE_P(Results, PaperStudy, ::testing::ValuesIn(with_results()), test_name);

}  // namespace
