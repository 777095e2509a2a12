// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "scoring.hpp"

namespace rangecal::proof {

/// The kinds of worlds that the proof draws.
///   clean                      nothing planted
///   lambda-30/-50/-100/-400    one effect on the means, of that noncentrality
///   noise-50                   noise, tails, dependence, labels, gaps, grids that the oracle sees with 50 nats
///   absorbed                   what calibration takes up, at half to all of its typical size
///   twins                      exact twins that show, lambda 100
///   outside                    outside the catalogue, lambda 400 (200 nats)
///   pair                       two effects, lambda 250 each after the other
///   simulation-effect, -alike, -alpha, closed-loop    against a simulation
///   experiment                 effects with twins, lambda 100, and the experiment that is proposed
///   speed                      lambda 100, one world after the other
///   many-2, -3, -4, -5         so many causes, lambda 150 each alone and 60 or more beside the others
///   many-2-outliers, ...       the same worlds with 3 % of the readings too near or too far, in turns
///   everyday                   tables of known distances as a new user has them (everyday.hpp)
///   one-sided                  5 % of the readings too near or too far, nothing else
///   simulation-many-3          many-3 against a simulation without the causes
///   beside-unknown             many-2 and an effect outside the catalogue
///   large                      one effect of one to three times the bounds of commit b621615 (old_bounds.hpp)
///   formula-off                one effect of lambda 400 and 1600 in turns, its law's shape 10 % off (shape_error.hpp)
///   clean-any                  nothing planted, a random design (any_design.hpp)
///   stated-sigma               the spread of the stops' positions stated half or twice as large as it is, nothing else
const std::vector<std::string>& row_names();

/// The seed that draws the world of that row, number and design.
std::uint64_t world_seed(const std::string& row, std::uint64_t seed, int index, const std::string& design);

/// World number `index` of a row. The same (row, seed, index, design) gives the same world; design "line" or "turning".
/// Throws InputError for an unknown row or design.
Case draw_case(const std::string& row, std::uint64_t seed, int index, const std::string& design);

/// The recording of a case: the noise comes from the case's seed; `run` tells several runs apart. A
/// law's error of shape is in the recording of what is planted.
Recording record(const Case& the_case, const world::World& world, std::uint64_t run = 0);

/// True for the rows that are held against a simulation, and what that simulation recorded: another run of the clean world.
bool has_simulation(const std::string& row);
Recording simulation_of(const Case& the_case);

}  // namespace rangecal::proof
