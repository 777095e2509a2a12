// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/select/dictionary.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>

#include "diagnosis/battery.hpp"
#include "diagnosis/select/linear_search.hpp"
#include "solvers/diagnosis/select/made_worlds.hpp"

namespace rangecal::diagnosis {
namespace {

const testing::Planted two{{"encoder_ellipticity", 0.008}, {"path_curvature", 0.004}};

int block_of(const Dictionary& dictionary, const std::string& id) {
  for (std::size_t b = 0; b < dictionary.blocks().size(); ++b)
    if (dictionary.blocks()[b].member == id) return static_cast<int>(b);
  return -1;
}

Eigen::VectorXd scores_of(const Dictionary& dictionary, int block) {
  const Block& b = dictionary.blocks()[static_cast<std::size_t>(block)];
  return dictionary.scores().segment(b.first, b.size);
}

TEST(Dictionary, PredictsWhatTheBatteryDoes) {
  const testing::SeedFit seed(testing::recording_with(two, "Dictionary.Promises"));
  const Dictionary dictionary(seed.rows, seed.fit, {});
  const Battery battery = Battery::of_nothing(seed.rows, {}, seed.fit.state, {});
  for (const char* id : {"encoder_ellipticity", "encoder_eccentricity", "path_curvature", "bearing_offset"}) {
    const std::vector<Question> questions = battery.questions_of(*find_effect(id));
    const int block = block_of(dictionary, id);
    ASSERT_GE(block, 0) << id;
    const Eigen::VectorXd g = scores_of(dictionary, block);
    const double statistic = g.dot(dictionary.own(static_cast<std::size_t>(block)).llt().solve(g));
    ASSERT_EQ(questions.size(), 1u);
    EXPECT_NEAR(statistic, questions[0].statistic, 1e-6 * statistic) << id;
  }
}

TEST(Dictionary, GramIsSymmetric) {
  const testing::SeedFit seed(testing::recording_with(two, "Dictionary.Gram"));
  Dictionary dictionary(seed.rows, seed.fit, {});
  const int a = dictionary.blocks()[static_cast<std::size_t>(block_of(dictionary, "settling"))].first;
  const int b =
      dictionary.blocks()[static_cast<std::size_t>(block_of(dictionary, "encoder_ellipticity"))].first;
  const double scale = std::sqrt(dictionary.gram(a)[a] * dictionary.gram(b)[b]);
  EXPECT_NEAR(dictionary.gram(a)[b], dictionary.gram(b)[a], 1e-9 * scale);
  EXPECT_GT(dictionary.gram(a)[a], 0.0);
}

/// At a fit its own effects are put back: their estimates on the linearised problem are the fit's parameters.
TEST(Dictionary, PutsTheFitsOwnEffectsBack) {
  testing::SeedFit seed(testing::recording_with(two, "Dictionary.PutsBack"));
  Model model;
  for (const auto& [id, size] : two)
    model.push_back({find_effect(id), find_effect(id)->start_grid(seed.rows.context).front()});
  const Fit fit = refit(seed.rows, model, seed.fit.state, seed.options);
  ASSERT_TRUE(fit.ok);
  Dictionary dictionary(seed.rows, fit, {});
  const std::vector<LinearSet> sets =
      search_linear(seed.rows, dictionary, fit.model, {40.0, 20.0}, SelectionPriors{});
  const auto same = std::find_if(sets.begin(), sets.end(), [](const LinearSet& set) {
    return set.model.size() == 2 && set.model[0].effect->info().id == two[0].first &&
           set.model[1].effect->info().id == two[1].first;
  });
  ASSERT_NE(same, sets.end());
  EXPECT_EQ(same, sets.begin()) << "the likeliest";
  const double gained =
      seed.fit.nll - fit.nll;  // its noise is less than the seed model's, in which that is counted
  EXPECT_GT(same->gain, gained);
  EXPECT_LT(same->gain, 1.3 * gained);
  for (std::size_t e = 0; e < 2; ++e)
    for (Eigen::Index j = 0; j < fit.model[e].parameters.size(); ++j)
      EXPECT_NEAR(same->model[e].parameters[j], fit.model[e].parameters[j],
                  0.02 * fit.model[e].effect->info().parameters[static_cast<std::size_t>(j)].typical);
}

/// No one member more, less or another one is likelier than the set that the search says is likeliest.
TEST(LinearSearch, EndsWhereNoStepGains) {
  const testing::SeedFit seed(testing::recording_with(
      {{"encoder_ellipticity", 0.008}, {"path_curvature", 0.004}, {"settling", 0.012}}, "LinearSearch.Ends"));
  Dictionary dictionary(seed.rows, seed.fit, {});
  const MemberCounts counts{40.0, 20.0};
  const std::vector<LinearSet> sets = search_linear(seed.rows, dictionary, {}, counts, SelectionPriors{});
  ASSERT_FALSE(sets.empty());
  EXPECT_TRUE(std::is_sorted(sets.begin(), sets.end(), [](const LinearSet& a, const LinearSet& b) {
    return a.log_posterior > b.log_posterior;
  }));
  std::vector<std::string> names;
  for (const ActiveEffect& a : sets.front().model) names.push_back(a.effect->info().id);
  EXPECT_EQ(names, (std::vector<std::string>{"encoder_ellipticity", "path_curvature", "settling"}));
  // From another start it is the same.
  const std::vector<LinearSet> again =
      search_linear(seed.rows, dictionary, {{find_effect("beam_offset"), Eigen::VectorXd::Zero(2)}}, counts,
                    SelectionPriors{});
  EXPECT_NEAR(again.front().log_posterior, sets.front().log_posterior, 1e-9);
}

}  // namespace
}  // namespace rangecal::diagnosis
