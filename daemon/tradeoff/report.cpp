#include "daemon/tradeoff/report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "daemon/tradeoff/svg_chart.h"

namespace overfly::tradeoff {
namespace {

constexpr const char* kStyle = R"css(
:root { color-scheme: light dark; --ink: #1c2430; --soft: #5b6675; --rule: #d9dee6; --paper: #fcfcfa; --card: #ffffff;
  --one: #1769aa; --two: #c2571a; --pale: #9fb3c8; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6eaf0; --soft: #9aa7b8; --rule: #303a47; --paper: #12171e;
  --card: #19202a; --one: #64b1f0; --two: #f0975c; --pale: #52647a; } }
body { font: 15px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper); margin: 0 auto;
  max-width: 1000px; padding: 24px 20px 80px; }
h1 { font-size: 26px; margin: 0 0 4px; } h2 { font-size: 20px; margin: 44px 0 6px; }
h3 { font-size: 16px; margin: 28px 0 6px; }
p { max-width: 75ch; } code { font: 13px ui-monospace, monospace; overflow-wrap: anywhere; }
.card { background: var(--card); border: 1px solid var(--rule); border-radius: 8px; padding: 12px; overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 13px; width: 100%; }
th { text-align: right; font-weight: 600; color: var(--soft); padding: 4px 8px; vertical-align: bottom; }
td { text-align: right; padding: 3px 8px; border-top: 1px solid var(--rule); white-space: nowrap; }
th:first-child, td:first-child { text-align: left; } tr.front td { font-weight: 600; }
tr.default td:first-child::after { content: " (default)"; color: var(--soft); font-weight: 400; }
.noisy { color: var(--two); } .facts td { text-align: left; white-space: normal; }
svg { width: 100%; height: auto; display: block; }
.grid { stroke: var(--rule); } .tick { fill: var(--soft); font-size: 12px; } .title { fill: var(--ink); font-size: 13px; }
polyline.front { fill: none; stroke: var(--one); stroke-width: 1.5; } .best { fill: var(--one); }
.other { fill: var(--pale); } .ring { fill: none; stroke: var(--two); stroke-width: 1.5; }
.time { fill: var(--one); } .error { fill: var(--two); }
details { margin-top: 10px; } summary { cursor: pointer; color: var(--soft); }
)css";

const char* titleOf(const std::string& part) {
  if (part == "sweep") return "Space sweep: heights";
  if (part == "adjustment") return "Pose adjustment";
  if (part == "colour") return "Colour on disk and on the link";
  if (part == "heights") return "Heights on disk and on the link";
  if (part == "preview") return "Preview pictures";
  return "Float32 against double";
}

const char* unitOf(const std::string& part) {
  if (part == "adjustment") return "processor ms per frame";
  if (part == "preview") return "processor ms per picture";
  if (part == "precision") return "processor ms per million texels";
  return "processor ms per tile";
}

std::vector<std::string> partsOf(const ReportSection& section) {
  std::vector<std::string> parts;
  for (const Trial& trial : section.trials)
    if (std::find(parts.begin(), parts.end(), trial.part) == parts.end()) parts.push_back(trial.part);
  return parts;
}

std::string number(double value) {
  if (!std::isfinite(value)) return "&#8734;";
  const double size = std::abs(value);
  if (size >= 1000) return fmt::format("{:.0f}", value);
  if (size >= 10) return fmt::format("{:.1f}", value);
  return size >= 0.001 || size == 0 ? fmt::format("{:.3f}", value) : fmt::format("{:.1e}", value);
}

std::string tableOf(const std::vector<const Trial*>& trials) {
  std::string html = "<table><tr><th>setting</th><th>ms</th><th>spread</th><th>wall ms</th>";
  html += "<th>" + escaped(trials.front()->error_name) + "</th>";
  for (const auto& [name, value] : trials.front()->figures) html += "<th>" + escaped(name) + "</th>";
  html += "</tr>";
  for (const Trial* trial : trials) {
    html += fmt::format("<tr class=\"{}{}\"><td>{}</td><td>{}</td><td{}>{:.0f} %</td><td>{}</td><td>{}</td>",
                        trial->on_front ? "front " : "", trial->is_default ? "default" : "",
                        escaped(trial->setting), number(trial->processor.median_ms),
                        trial->processor.noisy() ? " class=\"noisy\"" : "", 100 * trial->processor.spread(),
                        number(trial->wall.median_ms), number(trial->error));
    for (const auto& [name, value] : trial->figures) html += "<td>" + number(value) + "</td>";
    html += "</tr>";
  }
  return html + "</table>";
}

std::string partHtml(const std::string& part, const std::vector<const Trial*>& trials) {
  std::string html = fmt::format("<h3>{}</h3>", titleOf(part));
  std::vector<ChartPoint> points;
  const Trial* standard = nullptr;
  for (const Trial* trial : trials) {
    points.push_back(
        {trial->processor.median_ms, trial->error, trial->setting, trial->on_front, trial->is_default});
    if (trial->is_default) standard = trial;
  }
  html += "<div class=\"card\">" + scatterChart(unitOf(part), trials.front()->error_name, points) + "</div>";
  std::vector<TornadoBar> bars;
  if (standard != nullptr)
    for (const Trial* trial : trials)
      if (!trial->is_default && trial->axis != "combined")
        bars.push_back({trial->setting, trial->processor.median_ms / standard->processor.median_ms,
                        trial->error / standard->error});
  if (bars.size() > 2 && (part == "sweep" || part == "adjustment"))
    html += "<p>What each single setting costs and buys, against the default:</p><div class=\"card\">" +
            tornadoChart(bars) + "</div>";
  std::vector<const Trial*> front;
  for (const Trial* trial : trials)
    if (trial->on_front) front.push_back(trial);
  std::sort(front.begin(), front.end(),
            [](const Trial* a, const Trial* b) { return a->processor.median_ms < b->processor.median_ms; });
  if (!front.empty()) {
    html += fmt::format(
        "<p>The front: {} settings that no other beats in both, over a factor {:.1f} in time.</p>",
        front.size(), front.back()->processor.median_ms / front.front()->processor.median_ms);
    html += "<div class=\"card\">" + tableOf(front) + "</div><details><summary>All " +
            std::to_string(trials.size()) + " settings</summary><div class=\"card\">" + tableOf(trials) +
            "</div></details>";
  } else {
    html += "<div class=\"card\">" + tableOf(trials) + "</div>";
  }
  return html;
}

std::string csvField(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) out += c == '"' ? "\"\"" : std::string(1, c);
  return out + "\"";
}

}  // namespace

std::string htmlOf(const Report& report) {
  std::string html =
      "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" "
      "content=\"width=device-width, initial-scale=1\"><title>What accuracy costs in time</title><style>" +
      std::string(kStyle) + "</style><h1>What accuracy costs in time</h1>";
  html +=
      "<p>Every point is the real pipeline with one choice of settings: to the right it takes longer, "
      "further "
      "down it errs less. Times are processor times of all threads, medians of the repeats; the spread is "
      "the "
      "largest minus the smallest, and stands out where the machine was too busy to trust it.</p>";
  html += "<table class=\"facts\">";
  for (const auto& [what, value] : report.machine)
    html += "<tr><td>" + escaped(what) + "</td><td>" + escaped(value) + "</td></tr>";
  html += "<tr><td>made by</td><td><code>" + escaped(report.command) + "</code></td></tr></table>";
  for (const ReportSection& section : report.sections) {
    html +=
        "<h2>" + escaped(section.name) + "</h2><p>Errors against: " + escaped(section.reference) + ".</p>";
    for (const std::string& part : partsOf(section)) {
      std::vector<const Trial*> trials;
      for (const Trial& trial : section.trials)
        if (trial.part == part) trials.push_back(&trial);
      html += partHtml(part, trials);
    }
  }
  return html + "</html>\n";
}

std::string csvOf(const Report& report) {
  std::string csv =
      "flight,part,axis,setting,default,front,processor_ms,processor_least_ms,processor_most_ms,repeats,"
      "noisy,"
      "wall_ms,error_name,error,figures\n";
  for (const ReportSection& section : report.sections)
    for (const Trial& t : section.trials) {
      std::string figures;
      for (const auto& [name, value] : t.figures)
        figures += fmt::format("{}{}={:.6g}", figures.empty() ? "" : ";", name, value);
      csv += fmt::format(
          "{},{},{},{},{},{},{:.4f},{:.4f},{:.4f},{},{},{:.4f},{},{:.6g},{}\n", csvField(section.name),
          t.part, csvField(t.axis), csvField(t.setting), t.is_default ? 1 : 0, t.on_front ? 1 : 0,
          t.processor.median_ms, t.processor.least_ms, t.processor.most_ms, t.processor.repeats,
          t.processor.noisy() ? 1 : 0, t.wall.median_ms, csvField(t.error_name), t.error, csvField(figures));
    }
  return csv;
}

std::string jsonOf(const Report& report) {
  using nlohmann::ordered_json;
  const auto timing = [](const Timing& t) {
    return ordered_json{{"median_ms", t.median_ms}, {"least_ms", t.least_ms}, {"most_ms", t.most_ms},
                        {"repeats", t.repeats},     {"spread", t.spread()},   {"noisy", t.noisy()}};
  };
  ordered_json root{
      {"command", report.command}, {"machine", ordered_json::object()}, {"flights", ordered_json::array()}};
  for (const auto& [what, value] : report.machine) root["machine"][what] = value;
  for (const ReportSection& section : report.sections) {
    ordered_json trials = ordered_json::array();
    for (const Trial& t : section.trials) {
      ordered_json figures = ordered_json::object();
      for (const auto& [name, value] : t.figures) figures[name] = value;
      trials.push_back({{"part", t.part},
                        {"axis", t.axis},
                        {"setting", t.setting},
                        {"default", t.is_default},
                        {"front", t.on_front},
                        {"processor", timing(t.processor)},
                        {"wall", timing(t.wall)},
                        {"error_name", t.error_name},
                        {"error", t.error},
                        {"figures", figures}});
    }
    root["flights"].push_back({{"name", section.name}, {"reference", section.reference}, {"trials", trials}});
  }
  return root.dump(2) + "\n";
}

Result<void> writeReport(const Report& report, const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) return fail(ErrorCode::Io, folder.string() + " cannot be made: " + error.message());
  for (const auto& [name, text] :
       {std::pair{"report.html", htmlOf(report)}, std::pair{"tradeoff.csv", csvOf(report)},
        std::pair{"tradeoff.json", jsonOf(report)}}) {
    std::ofstream file(folder / name, std::ios::binary);
    file << text;
    file.close();
    if (!file) return fail(ErrorCode::Io, (folder / name).string() + " cannot be written");
  }
  return {};
}

}  // namespace overfly::tradeoff
