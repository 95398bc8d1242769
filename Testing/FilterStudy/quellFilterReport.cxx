// SPDX-License-Identifier: BSD-3-Clause
// Bias and variance of filters over many seeds.
//   quell-filter-report SOURCE_DIRECTORY [--seeds K] [--reference N]     writes Documentation/filters.md and its
//   pictures quell-filter-report --pipeline FILE.xml [-D var=value]... [--ticks N] [--only OUTPUT]... [--seeds K]
//   [--reference N]
//                                                                        prints the table of a pipeline's outputs
#include "quellFilterStudy.h"

#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <sstream>
#include <stdexcept>

namespace
{
using quell::Study;
using quell::StudyCase;

/// Two figures of a standard error's size, plain text: "0.0123".
std::string Number(double v)
{
  char text[32];
  std::snprintf(text, sizeof text, "%.3g", v);
  return text;
}

std::string Percent(double v, int digits = 2)
{
  char text[32];
  std::snprintf(text, sizeof text, "%+.*f %%", digits, 100 * v);
  return text;
}

/// An RGB picture, row 0 at the top.
struct Picture
{
  int Width, Height;
  std::vector<unsigned char> Pixels;
  Picture(int w, int h)
    : Width(w)
    , Height(h)
    , Pixels(std::size_t(w) * h * 3, 255)
  {
  }
  void Set(int x, int y, const double* c)
  {
    for (int k = 0; k < 3; ++k)
      this->Pixels[(std::size_t(y) * this->Width + x) * 3 + k] =
        (unsigned char)std::lround(255 * std::min(1., std::max(0., c[k])));
  }
  void Write(const std::string& file) const
  {
    auto out = OIIO::ImageOutput::create(file);
    OIIO::ImageSpec spec(this->Width, this->Height, 3, OIIO::TypeDesc::UINT8);
    spec.attribute("png:compressionLevel", 9);
    if (!out || !out->open(file, spec) || !out->write_image(OIIO::TypeDesc::UINT8, this->Pixels.data()) ||
        !out->close())
      throw std::runtime_error("cannot write " + file);
  }
};

double Encoded(double v)
{
  v = std::max(0., v);
  v = v / (1 + v) * 1.25;
  return v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1 / 2.4) - 0.055;
}

void PutColor(Picture& p, int left, const Study& s, const std::vector<float>& color)
{
  for (int y = 0; y < s.Height; ++y)
    for (int x = 0; x < s.Width; ++x)
    {
      double c[3];
      for (int k = 0; k < 3; ++k)
        c[k] = Encoded(color[(std::size_t(y) * s.Width + x) * 3 + k]);
      p.Set(left + x, s.Height - 1 - y, c);
    }
}

/// White: none; red: too bright, blue: too dark; full colour at 25 %.
void PutBias(Picture& p, int left, const Study& s, const std::vector<float>& bias)
{
  for (int y = 0; y < s.Height; ++y)
    for (int x = 0; x < s.Width; ++x)
    {
      const double b = std::max(-1., std::min(1., bias[std::size_t(y) * s.Width + x] / 0.25));
      const double c[3] = { b < 0 ? 1 + b : 1., 1 - std::fabs(b), b > 0 ? 1 - b : 1. };
      p.Set(left + x, s.Height - 1 - y, c);
    }
}

std::string Stage(const StudyCase& c)
{
  return c.Doc.substr(0, c.Doc.find(':'));
}
std::string What(const StudyCase& c)
{
  const auto colon = c.Doc.find(": ");
  return colon == std::string::npos ? c.Doc : c.Doc.substr(colon + 2);
}

constexpr const char* TableHead = "| case | stage | bias² | variance | relMSE | of unfiltered | energy | biased pixels "
                                  "|\n|---|---|---:|---:|---:|---:|---:|---:|\n";

std::string Row(const StudyCase& c, const StudyCase& none)
{
  std::ostringstream out;
  out << "| " << c.Name << " | " << Stage(c) << " | " << Number(c.Bias2) << " ± " << Number(c.Bias2Error) << " | "
      << Number(c.Variance) << " | " << Number(c.Error()) << " | " << Number(c.Error() / none.Error()) << " | "
      << Percent(c.Energy) << " ± " << Percent(c.EnergyError).substr(1) << " | " << Percent(c.Biased, 1).substr(1)
      << " |\n";
  return out.str();
}

struct Scene
{
  std::string Title, File;
  std::vector<std::pair<std::string, std::string>> Defines;
};

std::string About(const Study& s)
{
  std::ostringstream out;
  out << s.Width << " x " << s.Height << ", " << s.SamplesPerPixel << (s.SamplesPerPixel == 1 ? " sample" : " samples")
      << " per pixel, seeds 1 to " << s.Seeds << ", two references of " << s.ReferenceSamples << " samples";
  return out.str();
}

class Report
{
public:
  Report(const std::string& source, int seeds, int reference)
    : Source(source)
    , Seeds(seeds)
    , ReferenceSamples(reference)
    , Registry(quell::StudyRegistry())
  {
  }

  Study Run(const std::string& pipeline, const Scene& scene, int lastTick = 0) const
  {
    quell::StudyOptions o;
    o.File = this->Source + "/Testing/FilterStudy/" + pipeline;
    o.Defines = scene.Defines;
    if (!scene.File.empty())
      o.Defines.emplace_back("scene", this->Source + "/Data/Scenes/" + scene.File);
    o.Seeds = this->Seeds;
    o.ReferenceSamples = this->ReferenceSamples;
    o.LastTick = lastTick;
    o.Progress = [&](const std::string& text)
    { std::cerr << "\r\033[K" << pipeline << ", " << scene.Title << ": " << text << std::flush; };
    Study s = quell::RunStudy(o, this->Registry);
    std::cerr << "\n";
    return s;
  }

  void Write() const;

private:
  void Frames(std::ostream& out) const;
  void Edges(std::ostream& out, const Study& sharp, const Study& lens) const;
  void Time(std::ostream& out) const;
  void Samples(std::ostream& out) const;
  void Layers(std::ostream& out) const;
  void Picture2(
    const std::string& name, const Study& a, const StudyCase& ca, const Study& b, const StudyCase& cb) const;
  std::string Images() const { return this->Source + "/Documentation/images/filters"; }

  std::string Source;
  int Seeds, ReferenceSamples;
  quell::StageRegistry Registry;
};

void Report::Picture2(
  const std::string& name, const Study& a, const StudyCase& ca, const Study& b, const StudyCase& cb) const
{
  const int gap = 4;
  Picture p(2 * a.Width + 2 * b.Width + 3 * gap, std::max(a.Height, b.Height));
  PutColor(p, 0, a, ca.Sample);
  PutBias(p, a.Width + gap, a, ca.Bias);
  PutColor(p, 2 * (a.Width + gap), b, cb.Sample);
  PutBias(p, 2 * (a.Width + gap) + b.Width + gap, b, cb.Bias);
  p.Write(this->Images() + "/" + name + ".png");
}

void Report::Frames(std::ostream& out) const
{
  const Study box = this->Run("filters.xml", { "Cornell box", "cornell-box.gltf", {} });
  const Study gallery =
    this->Run("filters.xml", { "material gallery", "material-gallery.gltf",
                               { { "width", "160" }, { "height", "90" }, { "length", "1" }, { "luminance", "0.6" } } });
  out << "## One frame\n\nEvery case filters the light (direct + indirect); what the camera sees of lamps and sky "
         "(emission) is added after.\n\n**Cornell box** ("
      << About(box) << "):\n\n"
      << TableHead;
  for (const StudyCase& c : box.Cases)
    out << Row(c, box.Cases[0]);
  out << "\n**Material gallery** (" << About(gallery) << "):\n\n" << TableHead;
  for (const StudyCase& c : gallery.Cases)
    out << Row(c, gallery.Cases[0]);
  const Study lens = this->Run("filters.xml",
    { "material gallery, lens", "material-gallery.gltf",
      { { "width", "160" }, { "height", "90" }, { "length", "1" }, { "luminance", "0.6" }, { "lens", "0.06" } } });
  this->Edges(out, gallery, lens);
  out << "\nThe cases are the outputs of [`filters.xml`](../Testing/FilterStudy/filters.xml), which shows every "
         "setting.\n\n";
  std::string stage;
  for (std::size_t i = 0; i < box.Cases.size(); ++i)
  {
    const StudyCase &a = box.Cases[i], &b = gallery.Cases[i];
    if (Stage(a) != stage)
    {
      stage = Stage(a);
      out << "### " << stage << "\n\n";
    }
    out << "**" << a.Name << "**: " << What(a) << ". Against unfiltered, the variance is "
        << Number(a.Variance / box.Cases[0].Variance) << " (box) and " << Number(b.Variance / gallery.Cases[0].Variance)
        << " (gallery) times as large, and bias² is " << Number(100 * a.Bias2 / a.Error()) << " % and "
        << Number(100 * b.Bias2 / b.Error()) << " % of what error is left.";
    if (!a.Report.empty())
      out << " The last seed's ledger: " << a.Report << " (box); " << b.Report << " (gallery).";
    out << "\n\n![" << a.Name << "](images/filters/" << a.Name << ".png)\n\n";
    this->Picture2(a.Name, box, a, gallery, b);
  }
}

void Report::Edges(std::ostream& out, const Study& sharp, const Study& lens) const
{
  out
    << "\n**Anti-aliasing and depth of field.** The gallery again, through a pinhole and through a lens of radius "
       "0.06: relMSE, as a part of unfiltered, over all pixels and over the *mixed* ones, whose samples hit several "
       "surfaces (variance of their normals or albedos above 0.01: "
    << Percent(sharp.Mixed, 1).substr(1) << " of the pixels with the pinhole, " << Percent(lens.Mixed, 1).substr(1)
    << " with the lens). A mixed pixel's normal, albedo and depth are means of unlike things: guides that match nobody "
       "leave it as noisy as it came, guides that match anybody smear it. Ways out: filter samples before they are "
       "averaged ([below](#accumulated-or-individual-samples); [a picture](frames.md#a-lens-out-of-focus)), widen a "
       "guide's tolerance by its own variance (`varianceAlbedo`, `varianceNormal`), or give the pixel the normal of "
       "one of its surfaces (`NormalSnap`, case `snapped`), which pays at straight edges (the Cornell box, "
       "[a room](frames.md#a-room-by-cycles)) and costs on the gallery's balls, whose normals turn within a pixel.\n\n"
       "| case | pinhole, all | pinhole, mixed | lens, all | lens, mixed |\n|---|---:|---:|---:|---:|\n";
  const StudyCase &a0 = sharp.Cases[0], &b0 = lens.Cases[0];
  for (std::size_t i = 0; i < sharp.Cases.size(); ++i)
  {
    const StudyCase &a = sharp.Cases[i], &b = lens.Cases[i];
    out << "| " << a.Name << " | " << Number(a.Error() / a0.Error()) << " | " << Number(a.MixedError / a0.MixedError)
        << " | " << Number(b.Error() / b0.Error()) << " | " << Number(b.MixedError / b0.MixedError) << " |\n";
  }
}

void Report::Time(std::ostream& out) const
{
  const Study box = this->Run("temporal.xml", { "Cornell box", "cornell-box.gltf", {} }, 7);
  out << "## Over time\n\nThe last of eight frames of the Cornell box (" << About(box)
      << "), camera and scene standing still, so that whatever is off is the filter's own doing:\n\n"
      << TableHead;
  for (const StudyCase& c : box.Cases)
    out << Row(c, box.Cases[0]);
  out << "\nSettings: [`temporal.xml`](../Testing/FilterStudy/temporal.xml). `TemporalAntialias` averages c / (1 + c): "
         "it is made for light that is filtered already, and its bias is what outliers lose there.\n\n";
}

void Report::Samples(std::ostream& out) const
{
  out << "## Accumulated or individual samples?\n\n"
         "Diffuse light of eight samples per pixel, once as means over the pixel with means of the guides "
         "(pixel-based), once one by one, each with its own guides (`SampleFilter`, "
         "[`samples.xml`](../Testing/FilterStudy/samples.xml)). *Mixed* pixels see several surfaces: the variance of "
         "their samples' normals or albedos is above 0.01. Time is that of all stages behind the sources, per frame, "
         "relative to the pixel-based filter in the same run on this machine; memory is that of the arrays which the "
         "filter reads and writes, per pixel.\n\n";
  const std::vector<Scene> scenes = { { "material gallery, pinhole", "material-gallery.gltf", {} },
    { "material gallery, lens of radius 0.06", "material-gallery.gltf", { { "lens", "0.06" } } },
    { "Cornell box, pinhole", "cornell-box.gltf", { { "width", "128" }, { "height", "128" } } } };
  // radiance + albedo + normal: 9 floats, depth: 1, of each sample; 3 out. Clamps: radiance in and out; means: buffers
  // in.
  const std::map<std::string, int> floats = { { "pixel", 13 }, { "pixel-loose", 13 }, { "pixel-noisy-guides", 18 },
    { "same", 83 }, { "all", 83 }, { "clamp-pixel", 6 }, { "clamp-samples", 51 }, { "clamp-pixel-filter", 16 },
    { "clamp-samples-filter", 107 }, { "gini-of-samples", 27 }, { "median-of-samples", 27 } };
  for (const Scene& scene : scenes)
  {
    const Study s = this->Run("samples.xml", scene);
    const StudyCase& pixel = *s.Find("pixel");
    const StudyCase& none = *s.Find("none");
    out << "**" << scene.Title << "** (" << About(s) << "; " << Percent(s.Mixed, 1).substr(1)
        << " of the pixels are mixed):\n\n"
           "| case | what | bias² | variance | relMSE | on mixed pixels | energy | time | memory |\n"
           "|---|---|---:|---:|---:|---:|---:|---:|---:|\n";
    for (const StudyCase& c : s.Cases)
    {
      const auto memory = floats.find(c.Name);
      out << "| " << c.Name << " | " << What(c) << " | " << Number(c.Bias2) << " ± " << Number(c.Bias2Error) << " | "
          << Number(c.Variance) << " | " << Number(c.Error()) << " | " << Number(c.MixedError) << " | "
          << Percent(c.Energy) << " | ";
      if (memory == floats.end())
        out << "| |\n";
      else
      {
        char time[32];
        std::snprintf(time, sizeof time, "%.2g", c.Seconds / pixel.Seconds);
        out << time << " | " << 4 * memory->second << " B |\n";
      }
    }
    out << "\n";
    const StudyCase &same = *s.Find("same"), &all = *s.Find("all"), &clampPixel = *s.Find("clamp-pixel"),
                    &clampSamples = *s.Find("clamp-samples");
    out << "Against the pixel-based filter, relMSE is " << Number(same.Error() / pixel.Error()) << " (Same) and "
        << Number(all.Error() / pixel.Error()) << " (All) times as large, on mixed pixels "
        << Number(same.MixedError / pixel.MixedError) << " and " << Number(all.MixedError / pixel.MixedError)
        << "; unfiltered, mixed pixels have " << Number(none.MixedError)
        << ". Clamping each sample instead of their mean: " << Percent(clampSamples.Energy) << " of energy against "
        << Percent(clampPixel.Energy) << ", variance " << Number(clampSamples.Variance) << " against "
        << Number(clampPixel.Variance) << ".\n\n";
  }
}

void Report::Layers(std::ostream& out) const
{
  out << "## Layers apart\n\n"
         "One filter (twice bilateral, [`library.xml`](../Data/Pipelines/library.xml)) on all light together, with "
         "narrow "
         "and with wide kernels, and on layers apart with kernels of their own: narrow where shadows fall, wide where "
         "light has bounced, narrowest where mirrors reflect. Emission is never filtered. Settings: "
         "[`layers.xml`](../Testing/FilterStudy/layers.xml), those of the shipped `layers-*.xml`.\n\n";
  const std::vector<Scene> scenes = { { "Material gallery", "material-gallery.gltf", {} },
    { "Cornell box", "cornell-box.gltf", { { "width", "128" }, { "height", "128" } } } };
  for (const Scene& scene : scenes)
  {
    const Study s = this->Run("layers.xml", scene);
    out << "**" << scene.Title << "** (" << About(s) << "):\n\n"
        << "| case | what | bias² | variance | relMSE | of unfiltered | energy | biased pixels "
           "|\n|---|---|---:|---:|---:|---:|---:|---:|\n";
    for (const StudyCase& c : s.Cases)
      out << "| " << c.Name << " | " << What(c) << " | " << Number(c.Bias2) << " ± " << Number(c.Bias2Error) << " | "
          << Number(c.Variance) << " | " << Number(c.Error()) << " | " << Number(c.Error() / s.Cases[0].Error())
          << " | " << Percent(c.Energy) << " ± " << Percent(c.EnergyError).substr(1) << " | "
          << Percent(c.Biased, 1).substr(1) << " |\n";
    const StudyCase &narrow = *s.Find("together-narrow"), &wide = *s.Find("together-wide"),
                    &apart = *s.Find("direct-indirect"), &lobes = *s.Find("diffuse-specular");
    out << "\nDirect and indirect light apart: " << Number(apart.Variance / narrow.Variance)
        << " times the variance and " << Number(apart.Bias2 / narrow.Bias2)
        << " times the bias² of narrow kernels on everything, " << Number(apart.Variance / wide.Variance) << " and "
        << Number(apart.Bias2 / wide.Bias2) << " times those of wide ones. By relMSE the best case is "
        << std::min_element(s.Cases.begin(), s.Cases.end(),
             [](const StudyCase& a, const StudyCase& b) { return a.Error() < b.Error(); })
             ->Name
        << "; the least bias of the filtered ones has "
        << (lobes.Bias2 < apart.Bias2 && lobes.Bias2 < narrow.Bias2 ? lobes.Name
             : apart.Bias2 < narrow.Bias2                           ? apart.Name
                                                                    : narrow.Name)
        << ".\n\n";
  }
  out
    << "In each scene some split beats one of the two uniform kernels in bias and variance both, and at eight samples "
       "and these sizes the better uniform kernel beats every split by relMSE: it has to be known, and it is another "
       "one "
       "in the other scene. What splits win shows where the kinds of light differ (mirrors next to walls, sharp "
       "shadows "
       "under soft light); it is lost where wide kernels blur indirect light more than its noise is worth.\n\n";
}

void Report::Write() const
{
  std::filesystem::create_directories(this->Images());
  std::ostringstream out;
  out << "# Filters: bias and variance\n\n"
         "Made by `./bootstrap.sh report filters`; nothing here is written by hand. Every filter runs, with the "
         "settings that the linked pipelines show, on pictures of many seeds. With t the mean over K seeds, s² the "
         "variance over seeds and r1, r2 two references of many samples and seeds of their own, r their mean:\n\n"
         "- **bias²** is the mean over pixels and channels of ((t - r1)(t - r2) - s²/K) / (r² + 0.01), **variance** "
         "that of s² / (r² + 0.01). Together they are **relMSE**, the error of one picture on average. Noise of the "
         "K pictures and of the references does not count as bias, so a bias² near zero can come out negative; ± is "
         "the standard error, from the spread over blocks of 8 x 8 pixels.\n"
         "- **energy** is the sum of the luminance against the reference's, less 1; ± is its standard error.\n"
         "- **biased pixels** are off by more than three standard errors; about 0.3 % are so by chance, somewhat "
         "more where the noise is heavy-tailed.\n\n"
         "Pictures: the first seed's result, then the bias of every pixel's luminance (red: too bright, blue: too "
         "dark, full colour at 25 % of the reference + 0.1), for the Cornell box and for the material gallery. What "
         "is left white is as bright as it should be; the grain is the noise of "
      << this->Seeds << " seeds.\n\n";
  this->Frames(out);
  this->Time(out);
  this->Samples(out);
  this->Layers(out);
  const std::string page = this->Source + "/Documentation/filters.md";
  std::ofstream file(page);
  file << out.str();
  if (!file.flush())
    throw std::runtime_error("cannot write " + page);
  std::cout << page << "\n";
}
}

namespace
{
void PrintTable(const quell::StudyOptions& options)
{
  const Study s = quell::RunStudy(options, quell::StudyRegistry());
  std::cerr << "\n";
  std::cout << About(s) << "\n\n" << TableHead;
  for (const StudyCase& c : s.Cases)
    std::cout << Row(c, s.Cases[0]);
}

int Usage()
{
  std::cerr
    << "usage: quell-filter-report SOURCE_DIRECTORY [--seeds K] [--reference N]\n"
       "       quell-filter-report --pipeline FILE.xml [-D var=value]... [--ticks N] [--only OUTPUT]... [--seeds K] "
       "[--reference N]\n"
       "The first writes Documentation/filters.md, the second prints the table of a pipeline's outputs (its source\n"
       "is called pt, its first output is what the others are compared with).\n";
  return 2;
}
}

int main(int argc, char** argv)
{
  std::string source;
  quell::StudyOptions options;
  int ticks = 1;
  for (int i = 1; i < argc; ++i)
  {
    const std::string a = argv[i];
    if (a[0] != '-')
    {
      if (!source.empty())
        return Usage();
      source = a;
      continue;
    }
    if (i + 1 == argc)
      return Usage();
    const std::string value = argv[++i];
    const auto equals = value.find('=');
    if (a == "--seeds")
      options.Seeds = std::atoi(value.c_str());
    else if (a == "--reference")
      options.ReferenceSamples = std::atoi(value.c_str());
    else if (a == "--ticks")
      ticks = std::atoi(value.c_str());
    else if (a == "--only")
      options.Only.push_back(value);
    else if (a == "--pipeline")
      options.File = value;
    else if (a == "-D" && equals != std::string::npos)
      options.Defines.emplace_back(value.substr(0, equals), value.substr(equals + 1));
    else
      return Usage();
  }
  if (source.empty() == options.File.empty() || options.Seeds < 2 || options.ReferenceSamples < 2 || ticks < 1)
    return Usage();
  try
  {
    if (source.empty())
    {
      options.LastTick = ticks - 1;
      options.Progress = [](const std::string& text) { std::cerr << "\r\033[K" << text << std::flush; };
      PrintTable(options);
    }
    else
      Report(source, options.Seeds, options.ReferenceSamples).Write();
  }
  catch (const std::exception& e)
  {
    std::cerr << "\nquell-filter-report: " << e.what() << "\n";
    return 1;
  }
  return 0;
}
