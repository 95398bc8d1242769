// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellReproject_h
#define quellReproject_h

#include "quellImageView.h"
#include "quellKernelsModule.h"
#include "quellVector.h"

namespace quell
{
/// Projects and unprojects with one camera, in double. Only the rows of worldToNdc that make x, y and w are used, so
/// the near and far planes do not matter: with A = the first three columns of those rows and b = the last one,
///   (ndc.x z, ndc.y z, z) = A p + b      and      p = A^-1 ((ndc.x z, ndc.y z, z) - b).
/// A parallel camera (w constant) takes its depth from worldToCamera instead (the camera looks along -z).
/// A matrix that cannot be inverted (field of view 0 or 180 degrees, aspect 0, non-finite entries) makes an invalid
/// view.
class QUELLKERNELS_EXPORT ViewGeometry
{
public:
  ViewGeometry() = default;
  /// `offset` is added to every point first: points given relative to another origin than the matrices'.
  ViewGeometry(const Mat4& worldToNdc, const Mat4& worldToCamera, const Vec3d& offset = Vec3d()) noexcept;

  bool IsValid() const noexcept { return this->Valid; }
  /// False where the point is behind the camera or as good as in its plane (w <= 1e-6 max(|x|, |y|)).
  bool Project(const Vec3d& point, double& ndcX, double& ndcY, double& depth) const noexcept;
  /// A point infinitely far away. Every pixel of a parallel camera looks the same way, so that gives (0, 0) for all.
  bool ProjectDirection(const Vec3d& direction, double& ndcX, double& ndcY) const noexcept;
  Vec3d Unproject(double ndcX, double ndcY, double depth) const noexcept;
  /// From the eye through ndc, with length 1 along the view axis.
  Vec3d Direction(double ndcX, double ndcY) const noexcept;

private:
  friend struct ViewCoefficients;
  bool Valid = false, Parallel = false;
  Vec3d Rows[3]; ///< of x, y and depth
  double Shift[3] = { 0, 0, 0 };
  double W = 1; ///< parallel cameras: the constant w
  Vec3d Inverse[3];
};

/// Why a pixel has no history, or how it got it. From `NoHistory` on, the pixel has none (history 0).
enum class ReprojectMask
{
  Used = 0,          ///< every bilinear tap was valid
  SomeTaps = 1,      ///< some taps were rejected, the others renormalised
  Neighbourhood = 2, ///< average of the valid pixels of the 3 x 3 around the nearest one
  NoHistory = 3,     ///< there is no previous frame
  OffScreen = 4,     ///< outside of the previous frame; also a non-finite motion
  NoProjection = 5,  ///< behind the previous camera, or a camera matrix that cannot be inverted
  HitDiffers = 6,    ///< background became surface or the reverse
  IdDiffers = 7,
  DepthDiffers = 8,
  NormalDiffers = 9,
  BadHistory = 10, ///< not finite, or a pixel that had no sample yet (length 0)
  Background = 11  ///< nothing was hit, and the parameters say that such pixels have none
};

/// Views of the current frame and of what was kept of the previous one. Absent views switch their test off; `depth`
/// must be there. Current views need one pixel of halo for depth and id, previous views the whole frame.
struct ReprojectInputs
{
  ImageIn depth, normal, id, motion, position;
  ImageIn history, moments, length, previousDepth, previousNormal, previousId;
  ImageIn meanRest = {};          ///< what the moments' mean has beyond a float; needs `moments`
  Rect frame;                     ///< the whole frame
  ViewGeometry current, previous; ///< `previous` takes points relative to the current origin
  bool stillCamera = false;       ///< no camera is known: without motion, take it to stand still
};

struct ReprojectParameters
{
  double depthTolerance = 4;
  double depthEpsilon = 1e-3;
  double movingDepthTolerance = 0.1;
  double motionTolerance = 0.1;
  double normalThreshold = 0.9;
  double minimumWeight = 0.01;
  bool catmullRom = false;
  bool backgroundHistory = false; ///< whether pixels where nothing was hit have a history
};

/// Any of them may be absent.
struct ReprojectOutputs
{
  ImageOut radiance, moments, history, mask;
  ImageOut meanRest = {}; ///< 0 without the input of that name
};

/// Fetches, for each pixel x of `tile`, the previous frame's colour, moments and history length at q = x + motion.
///
/// Motion is the motion view's; without it, the projection of the pixel's point in the previous camera minus that in
/// the current one (so that equal cameras give exactly 0). Background points are infinitely far away. The four bilinear
/// taps (floor, also of negative coordinates) are tested one by one:
///   inside the frame; both hit something or both nothing; same id;
///   |z_expected - z_tap| <= depthTolerance (fwidth z + depthEpsilon z) + slack;
///   n . n_tap > normalThreshold |n| |n_tap| (two zero normals agree); colour, moments and length finite, length > 0.
/// fwidth z is the larger of the two axes' slopes; each is the smaller one-sided difference that stays on the surface.
///
/// z_expected is the depth that the point has in the PREVIOUS camera if it did not move itself; slack is 0 then. A
/// point moved where its motion differs from the camera's own by more than motionTolerance pixels. Motion vectors have
/// no third component, so its previous depth is known only roughly: where ids tell surfaces apart slack is
/// movingDepthTolerance z; otherwise it is the sideways distance, at that depth, that the extra motion stands for, i.e.
/// the object may have moved in depth as much as it moved sideways. Without cameras z_expected is the current depth and
/// slack movingDepthTolerance z.
///
/// A pixel where nothing was hit has no history unless backgroundHistory says so. The light that reaches it is 0 or,
/// where a surface covers part of it, that part; the surface moves on, the background does not move with it, and what
/// its history kept of the surface (1/n of it after n frames) would stay behind as specks. Nothing is lost: what is
/// seen of the background itself has no noise.
///
/// Weights of valid taps are renormalised when they sum to minimumWeight or more; otherwise the valid pixels of the 3 x
/// 3 around q are averaged; otherwise everything is 0. catmullRom sharpens the colour where all taps are valid (4 x 4
/// taps clamped to the range of the central four). Moments are (mean, central second moment), so a mix of taps with
/// weights w adds the spread of the means: M2 = sum w (M2_i + (mean_i - mean)^2). With meanRest the means are sums of
/// two floats, here and in the result. Without a length view, length is 1
/// where there is history. Sources: validated bilinear fetch of Schied et al. 2017; tolerances as in
/// Documentation/numerics.md.
///
/// Where motion is given and catmullRom is off, pixels with enough valid taps are computed in vectors: cameras in
/// double, the rest in float relative to the pixel (so the size of the frame costs no accuracy); within 1e-5 of the
/// scalar code, up to decisions that float rounding turns. All other pixels are done by the scalar code. The bits do
/// not depend on the tile.
QUELLKERNELS_EXPORT void Reproject(const ReprojectInputs& in, const ReprojectParameters& parameters,
  const ReprojectOutputs& out, const Rect& tile) noexcept;
QUELLKERNELS_EXPORT void ReprojectScalar(const ReprojectInputs& in, const ReprojectParameters& parameters,
  const ReprojectOutputs& out, const Rect& tile) noexcept; ///< all in double; reference, for tests

/// Weights of a Catmull-Rom spline for the samples at -1, 0, 1, 2; t in [0, 1). Exactly (0, 1, 0, 0) at t = 0.
inline void CatmullRomWeights(double t, double w[4]) noexcept
{
  const double t2 = t * t, t3 = t2 * t;
  w[0] = -0.5 * t + t2 - 0.5 * t3;
  w[1] = 1 - 2.5 * t2 + 1.5 * t3;
  w[2] = 0.5 * t + 2 * t2 - 1.5 * t3;
  w[3] = -0.5 * t2 + 0.5 * t3;
}
}

#endif
