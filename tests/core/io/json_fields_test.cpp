// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/json_fields.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace rangecal {
namespace {

enum class Colour { red, green };
const char* to_string(Colour colour) { return colour == Colour::red ? "red" : "green"; }
Colour colour_from_string(const std::string& text) {
  if (text == "red") return Colour::red;
  if (text == "green") return Colour::green;
  throw InputError("colour is '" + text + "', not one of red, green");
}

struct Part {
  std::string name;
  double size = 1.0;
  std::optional<double> weight;
};

void fields(JsonFields& json, Part& part) {
  json.required("name", part.name);
  json.optional("size", part.size);
  json.if_any("weight", part.weight);
}

struct Whole {
  Colour colour = Colour::red;
  int count = 0;
  bool open = false;
  std::optional<int> limit;
  std::vector<Part> parts;
  std::map<std::string, double> prices;
  Eigen::VectorXd alpha;
  std::optional<Eigen::Matrix2d> covariance;
  Eigen::Matrix2d turn = Eigen::Matrix2d::Identity();
  double low = 0.0, high = 0.0;
};

void fields(JsonFields& json, Whole& whole) {
  json.format({"whole/1", "whole/0"});
  json.word("colour", whole.colour, colour_from_string);
  json.whole("count", whole.count, 0, 9);
  json.required("open", whole.open);
  json.required("limit", whole.limit);
  json.required("parts", whole.parts);
  json.required("prices", whole.prices);
  json.required("alpha", whole.alpha);
  json.square("covariance", whole.covariance, 2);
  json.numbers("turn", whole.turn, 2, 2);
  json.required("range", std::tie(whole.low, whole.high));
  json.check(whole.low <= whole.high, "range[1]", "is below the first");
}

Whole example() {
  Whole whole;
  whole.colour = Colour::green;
  whole.count = 3;
  whole.open = true;
  whole.parts = {{"a", 0.1, 2.5}, {"b", std::nan(""), std::nullopt}};
  whole.prices = {{"x", 1.0 / 3.0}};
  whole.alpha = Eigen::Vector2d(0.5, std::nan(""));
  whole.covariance = (Eigen::Matrix2d() << 1, 2, 3, 4).finished();
  whole.turn << 1, 2, 3, 4;
  whole.low = -1.0;
  whole.high = 7.0;
  return whole;
}

const char* const text =
    R"({"format":"whole/1","colour":"green","count":3,"open":true,"limit":null,)"
    R"("parts":[{"name":"a","size":0.1,"weight":2.5},{"name":"b","size":null}],"prices":{"x":0.3333333333333333},)"
    R"("alpha":[0.5,null],"covariance":[[1.0,2.0],[3.0,4.0]],"turn":[1.0,3.0,2.0,4.0],"range":[-1.0,7.0]})";

TEST(JsonFields, AreWrittenInTheOrderOfTheListAndReadBack) {
  EXPECT_EQ(json_of(example()).dump(), text);
  Whole back;
  read_json(text, "file", back);
  EXPECT_EQ(json_of(back).dump(), text);
  EXPECT_EQ(back.colour, Colour::green);
  EXPECT_EQ(back.parts[0].weight, 2.5);
  EXPECT_TRUE(std::isnan(back.parts[1].size));
  EXPECT_EQ(back.covariance, example().covariance);
  EXPECT_EQ(back.turn, example().turn);
}

TEST(JsonFields, ErrorsNameThePath) {
  using Json = nlohmann::json;
  const auto error = [](const char* pointer, const Json& value) -> std::string {
    Json json = Json::parse(text);
    const Json::json_pointer at(pointer);
    if (value.is_discarded())
      json.at(at.parent_pointer()).erase(at.back());
    else
      json[at] = value;
    Whole whole;
    try {
      read_json(json.dump(), "file", whole);
    } catch (const InputError& caught) {
      return caught.what();
    }
    return "no error";
  };
  const Json missing = Json::value_t::discarded;
  EXPECT_EQ(error("/format", "whole/0"), "no error");
  EXPECT_EQ(error("/limit", 4), "no error");
  EXPECT_EQ(error("/count", 4.0), "no error");
  EXPECT_EQ(error("/parts/0/size", missing), "no error");
  EXPECT_EQ(error("/covariance", nullptr), "no error");
  // missing
  EXPECT_EQ(error("/limit", missing), "file: field 'limit': is missing");
  EXPECT_EQ(error("/count", nullptr), "file: field 'count': is missing");
  EXPECT_EQ(error("/parts/1/name", missing), "file: field 'parts[1].name': is missing");
  // unknown
  EXPECT_EQ(error("/parts/1/sise", 1.0),
            "file: field 'parts[1].sise': is unknown; known here: name, size, weight");
  EXPECT_EQ(error("/more", nullptr).rfind("file: field 'more': is unknown; known here: format, colour, ", 0),
            0u);
  // of another type
  EXPECT_EQ(error("", Json::array()), "file: is not an object");
  EXPECT_EQ(error("/open", 1), "file: field 'open': is neither true nor false");
  EXPECT_EQ(error("/parts", 1), "file: field 'parts': is not a list");
  EXPECT_EQ(error("/parts/0", 1), "file: field 'parts[0]': is not an object");
  EXPECT_EQ(error("/parts/0/name", 1), "file: field 'parts[0].name': is not a text");
  EXPECT_EQ(error("/prices", 1), "file: field 'prices': is not an object");
  EXPECT_EQ(error("/prices/x", nullptr), "file: field 'prices.x': is not finite");
  EXPECT_EQ(error("/alpha/1", "one"), "file: field 'alpha[1]': is not a number");
  for (const Json& count : {Json(1.5), Json("1"), Json(1e10), Json(-3e9), Json(18446744073709551615u)})
    EXPECT_EQ(error("/count", count), "file: field 'count': is not a whole number");
  // of another value
  EXPECT_EQ(error("/format", "whole/2"), "file: field 'format': is not whole/1");
  EXPECT_EQ(error("/colour", "blue"), "file: field 'colour': colour is 'blue', not one of red, green");
  EXPECT_EQ(error("/count", 10), "file: field 'count': is not a whole number from 0 to 9");
  EXPECT_EQ(error("/covariance", Json{{1.0, 2.0}}), "file: field 'covariance': is not 2 rows");
  EXPECT_EQ(error("/covariance/1", Json{1.0}), "file: field 'covariance[1]': is not 2 numbers");
  EXPECT_EQ(error("/turn", Json{1.0}), "file: field 'turn': has not 4 numbers");
  EXPECT_EQ(error("/turn/2", nullptr), "file: field 'turn': is not finite");
  EXPECT_EQ(error("/range", Json{1.0}), "file: field 'range': is not 2 values");
  EXPECT_EQ(error("/range/1", -2.0), "file: field 'range[1]': is below the first");
}

TEST(JsonFields, TextThatIsNoJsonIsNamedByItsFile) {
  Whole whole;
  try {
    read_json("{", "file", whole);
    FAIL();
  } catch (const InputError& error) {
    EXPECT_EQ(std::string(error.what()).rfind("file: is not JSON: parse error at line 1", 0), 0u)
        << error.what();
  }
}

}  // namespace
}  // namespace rangecal
