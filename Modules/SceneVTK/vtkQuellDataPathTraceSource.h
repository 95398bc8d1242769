// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellDataPathTraceSource
 * @brief   path-traces what a VTK program has: data on its input port, a whole vtkRenderer, or both
 *
 * A vtkQuellPathTraceSource (parameters, outputs, demand: see there) with an input port 0 for vtkPolyData, composite
 * data and every other data set that has a surface. Several connections are several objects. Without a renderer the
 * camera frames everything and a studio sky gives the light.
 *
 * **Updates.** Update() runs the pipelines that lead to the port and to the renderer's mappers, textures included, as
 * rendering does. The scene is made again where one of them, a property, a lookup table, a light, the camera, the list
 * of actors or the window's size has changed; otherwise it and the traced arrays stay.
 *
 * **Time.** Data upstream is asked for time tick / rate, in seconds. What changed from one tick to the next has motion,
 * see quell::SceneRecorder; UpdateTimeStep(tick) renders the next tick.
 *
 * **Background.** A renderer's background colour or gradient is painted behind the traced surfaces, into `radiance`,
 * `emission`, `halfA` and `halfB`, by what `alpha` leaves free; it lights nothing and is not seen through glass or
 * translucent surfaces. It is left out where the scene has a sky.
 *
 * The class is for programs: pipeline files have no VTK data to connect, and `quell nodes` does not list it.
 */
#ifndef vtkQuellDataPathTraceSource_h
#define vtkQuellDataPathTraceSource_h

#include "quellSceneFromVTK.h"
#include "vtkQuellPathTraceSource.h"
#include "vtkQuellSceneVTKModule.h"

class VTKQUELLSCENEVTK_EXPORT vtkQuellDataPathTraceSource : public vtkQuellPathTraceSource
{
public:
  static vtkQuellDataPathTraceSource* New();
  vtkTypeMacro(vtkQuellDataPathTraceSource, vtkQuellPathTraceSource);

  ///@{
  /// How the data of a connection looks. Default: quell::DataMaterial().
  void SetMaterial(const quell::DataMaterial& material) { this->SetMaterial(0, material); }
  void SetMaterial(int connection, const quell::DataMaterial& material);
  quell::DataMaterial GetMaterial(int connection = 0) const;
  ///@}

  ///@{
  /// Its actors, lights, camera and background; null: none. Width and Height are the window's where they are 0.
  void SetRenderer(vtkRenderer* renderer);
  vtkRenderer* GetRenderer() const;
  ///@}
  ///@{
  /// Width and Height of the options are replaced by the stage's own.
  void SetRendererOptions(const quell::RendererOptions& options);
  const quell::RendererOptions& GetRendererOptions() const;
  ///@}

  void CheckSettings() override;
  int ComputePipelineMTime(vtkInformation* request, vtkInformationVector** inInfoVec, vtkInformationVector* outInfoVec,
    int requestFromOutputPort, vtkMTimeType* mtime) override;
  vtkTypeBool ProcessRequest(
    vtkInformation* request, vtkInformationVector** inInfo, vtkInformationVector* outInfo) override;

  /// Scenes made so far.
  int GetNumberOfScenes() const;

protected:
  vtkQuellDataPathTraceSource();
  ~vtkQuellDataPathTraceSource() override;

  int FillInputPortInformation(int port, vtkInformation* info) override;
  int RequestUpdateExtent(vtkInformation*, vtkInformationVector**, vtkInformationVector*) override;
  void DescribeSource(int& width, int& height) override;
  void Execute(quell::StageFrame& frame) override;

private:
  bool HasSources();
  void PaintBackground(quell::StageFrame& frame);

  struct Sources;
  std::unique_ptr<Sources> From;

  vtkQuellDataPathTraceSource(const vtkQuellDataPathTraceSource&) = delete;
  void operator=(const vtkQuellDataPathTraceSource&) = delete;
};

#endif
