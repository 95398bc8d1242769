// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellFilterStudy_h
#define quellFilterStudy_h

#include "quellStageRegistry.h"

#include <functional>
#include <string>
#include <utility>
#include <vector>

namespace quell
{
/// Runs a pipeline for many seeds and splits the error of each of its outputs into bias and variance.
///
/// With t_k the output of seed k of K, t its mean, s^2 = Sum (t_k - t)^2 / (K - 1), and r1, r2 two references with
/// seeds of their own and many samples in the source `pt`, r their mean: the output called "reference" where there is
/// one (which is no case then), else pt:radiance:
///
///   bias^2   = mean over pixels and channels of ((t - r1) (t - r2) - s^2 / K) / (r^2 + 0.01)
///   variance = mean of s^2 / (r^2 + 0.01)
///   relMSE   = bias^2 + variance, what one seed's picture has on average
///   energy   = Sum l(t) / Sum l(r) - 1
///
/// so that neither the noise of the K pictures nor that of the references counts as bias; both figures are right on
/// average, and a small bias^2 may come out negative. Standard errors: of bias^2 from its spread over blocks of 8 x 8
/// pixels, of energy from its spread over seeds and between the references.
struct StudyOptions
{
  std::string File;                                         ///< the pipeline
  std::vector<std::pair<std::string, std::string>> Defines; ///< variable, value
  std::vector<std::pair<std::string, std::string>> Properties;
  std::vector<std::string> Only; ///< names of outputs; empty: all
  int Seeds = 16;
  int ReferenceSamples = 512; ///< per pixel, of each of the two references; of the last tick alone
  int LastTick = 0;           ///< ticks 0 ... LastTick run in order; the last is judged
  std::function<void(const std::string&)> Progress;
};

struct StudyCase
{
  std::string Name, Doc;
  double Bias2 = 0, Bias2Error = 0, Variance = 0;
  double Energy = 0, EnergyError = 0;
  double Biased = 0;     ///< part of the pixels whose luminance is off by more than 3 standard errors (chance: 0.003)
  double MixedError = 0; ///< relMSE over the pixels that see several surfaces
  double Seconds = 0;    ///< per frame, of the stages behind the sources that this output needs
  std::string Report;    ///< what the output's nodes said after the last seed
  std::vector<float> Sample; ///< the first seed's picture
  std::vector<float> Bias;   ///< (l(t) - l(r)) / (l(r) + 0.1) per pixel
  double Error() const { return this->Bias2 + this->Variance; }
};

struct Study
{
  int Width = 0, Height = 0, Seeds = 0, SamplesPerPixel = 0, ReferenceSamples = 0;
  double Mixed = 0;             ///< part of the pixels that see several surfaces
  std::vector<float> Reference; ///< r
  std::vector<StudyCase> Cases; ///< in the order of the file's outputs
  const StudyCase* Find(const std::string& name) const;
};

/// Throws std::runtime_error with the pipeline's diagnostics or the failing stage's sentence.
Study RunStudy(const StudyOptions& options, const StageRegistry& registry);
/// All stages of the project.
StageRegistry StudyRegistry();
}

#endif
