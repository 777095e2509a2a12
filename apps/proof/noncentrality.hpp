// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "seed_model.hpp"

namespace rangecal::proof {

/// Noncentrality lambda of the oracle's likelihood-ratio test for the mean of the readings: the least sum of squared
/// whitened residuals that the seed model leaves of the noise-free readings of `planted` [1]. Twice the nats that the
/// true effect gains in expectation.
double noncentrality(const SeedModel& model, const world::World& planted,
                     const Eigen::Vector3d* held_alpha = nullptr);
/// The same of the clean world itself: what else is in it.
double noncentrality(const world::World& clean);

/// Log-likelihood [nats] that the true law of the readings is expected to gain over the seed model: the divergence
///   KL( planted || seed model )
/// with alpha, landmarks and stops absorbed and the channel's sigma fitted anew. Means, variances and dependence are
/// Gaussian (stops, cell effects, AR(1) by their covariance); tails add their negentropy by quadrature; missing
/// readings the Bernoulli divergence and what truncation takes; a grid log(step / 1e-7) for every reading.
double oracle_nats(const SeedModel& model, const world::World& planted);

/// How the size of an effect is judged.
enum class Measure { lambda, nats };

/// The signal of an effect in the nuisance-free space: residual of the seed model's fit, projected at the clean world.
Signal projected(const SeedModel& model, const world::World& planted);

/// A size with the value of the measure that it reaches; `planted` is the world that has it.
struct Sized {
  double size = 0.0, value = 0.0;
  world::World planted;
};
/// The size of effect `id`, in the direction of `sign`, at which the measure reaches `target` to 1 %; what the size
/// leaves open is drawn from `seed`, the same for every size. Nothing if the effect's physical maximum stays below.
std::optional<Sized> size_for(const SeedModel& model, const std::string& id, double target, Measure measure,
                              std::uint64_t seed, double sign = 1.0,
                              const Eigen::Vector3d* held_alpha = nullptr);

}  // namespace rangecal::proof
