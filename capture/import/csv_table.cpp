#include "capture/import/csv_table.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>

namespace overfly::capture {
namespace {

std::vector<std::string> cellsOf(std::string_view line) {
  std::vector<std::string> cells(1);
  bool quoted = false;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const char c = line[i];
    if (c == '"') {
      if (quoted && i + 1 < line.size() && line[i + 1] == '"') {
        cells.back() += '"';
        ++i;
      } else {
        quoted = !quoted;
      }
    } else if (c == ',' && !quoted) {
      cells.emplace_back();
    } else {
      cells.back() += c;
    }
  }
  for (std::string& cell : cells) {
    const auto first = cell.find_first_not_of(" \t");
    const auto last = cell.find_last_not_of(" \t");
    cell = first == std::string::npos ? "" : cell.substr(first, last - first + 1);
  }
  return cells;
}

template <typename T>
std::optional<T> parse(const std::optional<std::string>& text) {
  if (!text || text->empty()) return std::nullopt;
  std::string_view digits = *text;
  if (digits.front() == '+') digits.remove_prefix(1);
  T value{};
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  if (error != std::errc() || end != digits.data() + digits.size()) return std::nullopt;
  return value;
}

}  // namespace

Result<CsvTable> CsvTable::parse(std::string_view text) {
  CsvTable table;
  if (text.starts_with("\xef\xbb\xbf")) text.remove_prefix(3);
  std::size_t line_number = 0;
  while (!text.empty()) {
    const auto end = text.find('\n');
    std::string_view line = text.substr(0, end);
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
    ++line_number;
    if (line.ends_with('\r')) line.remove_suffix(1);
    if (line.empty()) continue;
    std::vector<std::string> cells = cellsOf(line);
    if (!table.columns_.empty()) {
      table.rows_.push_back({line_number, std::move(cells)});
      continue;
    }
    for (std::size_t i = 0; i < cells.size(); ++i) {
      if (!table.columns_.emplace(cells[i], i).second) {
        return fail(ErrorCode::BadInput, fmt::format("the column \"{}\" is there twice", cells[i]));
      }
    }
  }
  if (table.columns_.empty()) return fail(ErrorCode::BadInput, "it is empty");
  return table;
}

std::optional<std::string> CsvTable::text(std::size_t row, const std::string& column) const {
  const auto found = columns_.find(column);
  if (found == columns_.end() || found->second >= rows_[row].cells.size()) return std::nullopt;
  return rows_[row].cells[found->second];
}

std::optional<double> CsvTable::number(std::size_t row, const std::string& column) const {
  const auto value = overfly::capture::parse<double>(text(row, column));
  return value && std::isfinite(*value) ? value : std::nullopt;
}

std::optional<std::int64_t> CsvTable::integer(std::size_t row, const std::string& column) const {
  return overfly::capture::parse<std::int64_t>(text(row, column));
}

}  // namespace overfly::capture
