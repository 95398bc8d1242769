// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellKernelFilter_h
#define quellKernelFilter_h

#include "quellImageView.h"
#include "quellKernelsModule.h"

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace quell
{
/// A matrix of weights with a centre: weight (dx, dy) multiplies pixel p + (dx, dy), |dx| <= RadiusX, |dy| <= RadiusY.
/// Weights are scaled so that the largest magnitude is 1.
struct FilterKernel
{
  int RadiusX = 0, RadiusY = 0;
  std::vector<float> Weights{ 1.f }; ///< row by row from the lowest (dy = -RadiusY) up
  std::vector<float> Across{}, Up{}; ///< Weights(dx, dy) = Across(dx) Up(dy); empty: not a product
  double Scale = 1;                  ///< true weight / stored weight, for sums that are not normalised

  bool Separable() const noexcept { return !this->Across.empty(); }
};

/// Half the side of the largest matrix.
constexpr int LargestKernelRadius = 64;

///@{ The fixed kernels; sums and squares of the normalised ones are in the tests.
QUELLKERNELS_EXPORT FilterKernel IdentityKernel();
QUELLKERNELS_EXPORT FilterKernel BoxKernel(int radius);
/// [1 3 1; 3 6 3; 1 3 1] / 22. Of rank 2: it cannot be done in two passes, and it turns a checkerboard's sign (-1/11).
QUELLKERNELS_EXPORT FilterKernel Peak3x3Kernel();
/// exp(-(dx^2 + dy^2) / 2 sigma^2) over the square of `radius` (negative: ceil(3 sigma), at least 1, at most 64).
/// sigma 0: identity; sigma of 1e30 and more: box.
QUELLKERNELS_EXPORT FilterKernel GaussianKernel(double sigma, int radius);
/// Numbers by blanks or commas, rows by semicolons or line ends, the top row first: "1 3 1; 3 6 3; 1 3 1". Odd numbers
/// of rows and columns, at most 129. False fills `error` with a sentence. A product of a column and a row is found and
/// kept as such where no weight is negative.
QUELLKERNELS_EXPORT bool ParseKernel(const std::string& text, FilterKernel& kernel, std::string& error);
/// Sum of the weights, and of their magnitudes.
QUELLKERNELS_EXPORT void KernelSums(const FilterKernel& kernel, double& sum, double& magnitude);
///@}

/// What the values are.
enum class KernelMode
{
  Mean,    ///< any linear quantity
  Variance ///< of independent values: filtered with the squared weights
};

/// Filters all (1 to 4) components of `in` with fixed weights:
///
///   normalize:  out(p) = r(p) + Sum w(q - p) m(q) (c(q) - r(p)) / Sum w(q - p) m(q)
///   else:       out(p) = Sum w(q - p) c(q)
///   Variance:   out(p) = Sum (w m)^2 v(q) / (Sum w m)^2,   or Sum w^2 v(q)
///
/// m is 1 for pixels inside the frame that are finite in `in` and, where given, in `gate` (the colour whose weights
/// another array, e.g. alpha, is to share), else 0; r is the value of p, or the mean of its finite 3 x 3 neighbours (0:
/// none) where p itself is not finite. So kernels are normalised by the weights that fall inside, constants are fixed
/// points to the last bit, and a normalised kernel keeps the sum over the interior. Where |Sum w m| is below 1e-6
/// Sum |w| m (possible with negative weights only; or no tap at all) out = r. Without `normalize` a pixel that is not
/// finite counts as its r, and one outside as 0. Differences and variances count up to 1e34. A negative variance is no
/// tap. `in.extent` and `gate.extent` cover the tile grown by the radius and 1, as far as the frame goes. Separable
/// kernels take two passes, with the same result. `scratch` holds KernelFilterScratch(...) floats. Returns the number
/// of pixels of `tile` that were not finite in `in`. The bits depend neither on the tile nor on the extent.
QUELLKERNELS_EXPORT std::int64_t KernelFilter(const ImageIn& in, const ImageIn& gate, const FilterKernel& kernel,
  bool normalize, KernelMode mode, const ImageOut& out, const Rect& tile, float* scratch) noexcept;
QUELLKERNELS_EXPORT std::size_t KernelFilterScratch(
  const ImageIn& in, const FilterKernel& kernel, const Rect& tile) noexcept;
/// The same straight from the formula in double, for tests.
QUELLKERNELS_EXPORT void KernelFilterScalar(const ImageIn& in, const ImageIn& gate, const FilterKernel& kernel,
  bool normalize, KernelMode mode, const ImageOut& out, const Rect& tile) noexcept;
}

#endif
