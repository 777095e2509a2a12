// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/curve_scale.hpp"

#include "rangecal/core/names.hpp"

namespace rangecal {
namespace {

constexpr auto family_names = names_of<CurveFamily>("curve", {{CurveFamily::polynomial, "polynomial"},
                                                              {CurveFamily::reciprocal, "reciprocal"},
                                                              {CurveFamily::spline, "spline"}});

}  // namespace

const char* to_string(CurveFamily family) { return family_names.name_of(family); }

CurveFamily curve_family_from_string(const std::string& text) { return family_names.value_of(text); }

}  // namespace rangecal
