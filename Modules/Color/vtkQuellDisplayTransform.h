// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellDisplayTransform
 * @brief   linear radiance to display values through an OpenColorIO view
 *
 * display = clamp(view(sane(radiance) 2^Exposure), 0, 1), view = the chosen display's view of the configuration,
 * applied to its scene_linear role.
 *
 * sane(): OpenColorIO 2.1 turns NaN and infinities into black and the largest floats into NaN, so a pixel with a
 * non-finite component is replaced by the mean of its finite neighbours (3 x 3; 0 when there are none) and counted, and
 * the exposed values are clamped to +-65504. Border: neighbours outside the frame do not count. Halo 1.
 */
#ifndef vtkQuellDisplayTransform_h
#define vtkQuellDisplayTransform_h

#include "vtkQuellColorModule.h"
#include "quellCountedRows.h"
#include "vtkQuellStage.h"

#include <memory>

class VTKQUELLCOLOR_EXPORT vtkQuellDisplayTransform : public vtkQuellStage
{
public:
  QUELL_STAGE(vtkQuellDisplayTransform);

  ///@{ OpenColorIO configuration; empty: the one shipped with Quell.
  void SetConfig(const std::string& path);
  const std::string& GetConfig() const { return this->Config; }
  ///@}
  ///@{ Names in the configuration; empty: its defaults (shipped: sRGB and ACES-like, others sRGB and Raw).
  void SetDisplay(const std::string& name);
  const std::string& GetDisplay() const { return this->Display; }
  void SetView(const std::string& name);
  const std::string& GetView() const { return this->View; }
  ///@}
  ///@{ Stops added before the view; default 0, range [-32, 32].
  vtkSetClampMacro(Exposure, double, -32., 32.);
  vtkGetMacro(Exposure, double);
  ///@}

  /// Where the shipped configuration is: $QUELL_DATA_DIR/Color, the installed share/quell/Color, the source tree's
  /// Data/Color. Throws quell::StageError naming them when it is in none.
  static std::string ShippedConfig();

  int HaloFor(int port) const override;
  void CheckSettings() override;

protected:
  vtkQuellDisplayTransform();
  ~vtkQuellDisplayTransform() override;
  void Prepare(quell::StageFrame& frame) override;
  void ExecuteTile(const quell::StageFrame& frame, const quell::Rect& tile) const override;

private:
  void SetText(std::string& member, const std::string& value);

  std::string Config, Display, View;
  double Exposure = 0;
  struct Internals;
  std::unique_ptr<Internals> Data;
  quell::CountedRows Counted;
  long long NonFinite = 0; ///< of the frame so far
  int FirstX = 0, FirstY = 0;

  vtkQuellDisplayTransform(const vtkQuellDisplayTransform&) = delete;
  void operator=(const vtkQuellDisplayTransform&) = delete;
};

#endif
