// SPDX-License-Identifier: BSD-3-Clause
/**
 * @class   vtkQuellStage
 * @brief   base of all image stages: ports by role, arrays by name, demand, history, tiling, failure
 *
 * A stage reads named arrays from vtkImageData (W x H x 1, float32, row 0 at the bottom) on input ports, one port per
 * role, and makes named arrays on its one output port. Derived classes declare a StageDescription and implement either
 * ExecuteTile (called in parallel, pure per tile) or Execute.
 *
 * **Demand.** A request for arrays travels upstream as a set (REQUESTED_ARRAYS). A stage only adds: port 0 gets what
 * was asked and is not made here, and every port what the stage reads there. No key at all means the primary output.
 * Each port's extent is the region grown by HaloFor(port), clipped to the whole frame; requests of several ports on one
 * producer are united. What a stage is asked for and does not make is passed through, by reference, from port 0.
 *
 * **History.** A delayed input has no VTK connection: SetHistory(port, image) gives the image that its producer had on
 * the previous frame (nullptr: there is none, the first frame).
 *
 * **Failure.** A StageError (or any exception) thrown while executing leaves all outputs empty, is reported through
 * vtkErrorMacro and kept in GetErrorText().
 */
#ifndef vtkQuellStage_h
#define vtkQuellStage_h

#include "quellCancelToken.h"
#include "quellConnectionCheck.h"
#include "quellFrameFacts.h"
#include "quellImageView.h"
#include "quellStageDescription.h"
#include "vtkImageAlgorithm.h"
#include "vtkQuellCoreModule.h"
#include "vtkSmartPointer.h"

#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

class vtkFloatArray;
class vtkImageData;
class vtkInformationIntegerKey;
class vtkInformationIntegerVectorKey;
class vtkQuellArraySetKey;

namespace quell
{
using ArraySet = std::set<std::string>;

/// Work done by a stage since it was made (or since ResetCounters).
struct StageCounters
{
  std::int64_t Executions = 0; ///< times Execute ran
  std::int64_t Pixels = 0;     ///< output pixels computed
  std::int64_t Bytes = 0;      ///< bytes of output arrays made
  std::int64_t Rays = 0;       ///< rays traced (sources)
  std::int64_t Paths = 0;      ///< camera paths traced (sources)
  std::int64_t Taps = 0;       ///< filter taps read
  std::int64_t NonFinite = 0;  ///< non-finite input pixels replaced
  std::int64_t Held = 0;       ///< bytes that the stage itself holds on to after the last execution, outputs included
  double Seconds = 0;          ///< wall time in Execute
};

/// Where a stage that samples is; a snapshot of the last whole pass.
struct SamplingStatus
{
  int Samples = 0, Target = 0; ///< per pixel; Target 0: the stage does not sample
  int Begun = 0;               ///< of Samples, those that were there when the execution began
  double SamplesPerSecond = 0; ///< of all pixels together; 0: not known yet
  double Noise = -1;           ///< median over pixels with noise: standard error / mean of luminance; -1: unknown
};

/// Where a filtered pixel comes from: its first output is the sum over all parts and pixels of weight times the part's
/// input, as far as pixels are finite. The weights of a filter that normalises them add up to 1.
struct PixelWeights
{
  struct Part
  {
    std::string Input;          ///< name of the port; of the connection, where several are connected: "radiance 2"
    Rect Window;                ///< frame coordinates
    std::vector<float> Weights; ///< row by row from Window.y0 up
    float At(int x, int y) const
    {
      return this->Window.contains(Rect{ x, y, x + 1, y + 1 })
               ? this->Weights[std::size_t(y - this->Window.y0) * std::size_t(this->Window.width()) +
                               std::size_t(x - this->Window.x0)]
               : 0.f;
    }
  };
  std::vector<Part> Parts;
};

/// When frames happen: tick t is at scene time t / Rate; ticks run over [First, First + Count).
struct Timeline
{
  int First = 0, Count = 1;
  double Rate = 24;
};

class StageFrame;
}

class VTKQUELLCORE_EXPORT vtkQuellStage : public vtkImageAlgorithm
{
public:
  vtkTypeMacro(vtkQuellStage, vtkImageAlgorithm);
  void PrintSelf(ostream& os, vtkIndent indent) override;

  /// The stage type's table; the same object for every instance of a class.
  virtual const quell::StageDescription& GetDescription() const = 0;

  ///@{
  /// By name and text, as XML, command line and viewer do. False fills `error` with a sentence.
  bool SetPropertyText(const std::string& name, const std::string& text, std::string& error);
  std::string GetPropertyText(const std::string& name) const;
  ///@}

  ///@{
  /// Name of the array that connection `connection` of a port reads; default: the port's own default array.
  void SetInputArray(int port, int connection, const std::string& name);
  const std::string& GetInputArray(int port, int connection) const;
  ///@}

  /// Connects `producer`'s array to the port with that name (adds a connection to a repeatable port).
  void ConnectInput(const std::string& port, vtkAlgorithm* producer, const std::string& array = std::string());

  ///@{
  /// Makes `port` a delayed input and gives the previous frame's image, which covers the whole frame; nullptr: no
  /// history yet. Setting the same image again changes nothing.
  void SetHistory(int port, vtkImageData* image);
  vtkImageData* GetHistory(int port) const;
  bool IsDelayed(int port) const;
  ///@}

  /// Arrays made even if nobody downstream asks: for plain VTK programs that look at GetOutput() themselves.
  void SetAlwaysMake(const quell::ArraySet& names);

  virtual void SetTimeline(const quell::Timeline& timeline);
  void SetCancelToken(std::shared_ptr<quell::CancelToken> token) { this->Token = std::move(token); }

  const quell::StageCounters& GetCounters() const { return this->Counters; }
  void ResetCounters() { this->Counters = quell::StageCounters(); }
  /// Why the last update failed; empty after a success.
  const std::string& GetErrorText() const { return this->ErrorText; }
  /// Things the user should know about the last execution (missing texture, non-finite pixels ...).
  const std::vector<std::string>& GetWarnings() const { return this->Warnings; }
  /// The one of them that counts over a frame: when the frame is made in bands, the next band's takes the place of this
  /// one. Empty: there is none.
  const std::string& GetCountedWarning() const { return this->CountedWarning; }
  /// One line that `quell run` prints after the last frame (CompareImages); empty: nothing to say.
  virtual std::string GetReport() const { return std::string(); }
  /// Files written by the last execution (writers), for the runner's summary.
  virtual std::vector<std::string> GetFilesWritten() const { return {}; }
  /// Facts about the run for files that keep them (pipeline text, hashes, versions); writers override.
  virtual void SetMetadata(const std::map<std::string, std::string>& entries);
  /// More of them that only the moment of writing knows (what the stages before took); asked while the stage executes.
  using MetadataSource = std::function<std::map<std::string, std::string>()>;
  virtual void SetMetadataSource(const MetadataSource& source);
  /// Extra attributes of one connection in XML (e.g. name="albedo" on a writer's layer). The base class knows none and
  /// fills `error`.
  virtual bool SetInputAttribute(
    int port, int connection, const std::string& name, const std::string& value, std::string& error);
  /// Lines for `quell explain`: what this stage leaves out in this scene and why.
  /// What a pass would ask of the stage is in its output information (REQUESTED_ARRAYS) while this is called.
  virtual std::vector<std::string> Explain() { return {}; }
  /// What a pixel costs with the properties as they are, in units of a usual filter (100 ns of one thread): weighs the
  /// stages of a progress bar before there are times, and is what CostModel multiplies by what it measured of the type.
  virtual double CostPerPixel() const { return 1; }
  /// Bytes that an execution over `region`, asked for these arrays, needs besides its inputs and outputs, and what the
  /// stage keeps of it: planes, sums, files' buffers; about, and rather too much. What `quell run --memory` and explain
  /// count. Asked of connected stages.
  virtual double ScratchBytes(const quell::Rect& region, const quell::Rect& whole, const quell::ArraySet& asked);

  /// Of the execution at work, for observers of its progress; on the thread that updates.
  virtual quell::SamplingStatus GetSamplingStatus() const { return {}; }
  /// Somebody looks at the progress: stages may spend a little on estimating what they report (noise). Changes no
  /// output.
  void SetWatched(bool watched) { this->Watched = watched; }

  ///@{
  /// The work in a frame that was finished early (CancelToken::Finish), as bytes with which another object of the same
  /// class, properties and inputs goes on, bit for bit as if it had not been interrupted. Empty: there is none.
  /// LoadWork is for the next execution; false (with a sentence) when the bytes make no sense. Work that turns out to
  /// be of something else is left aside with a warning.
  virtual std::string SaveWork() const { return std::string(); }
  virtual bool LoadWork(const std::string& bytes, std::string& error);
  ///@}

  ///@{
  /// The weights that made pixel (x, y) of the last execution, found by filtering marked pixels with the very code,
  /// inputs and properties of the filter. Inputs must still be there as they were; false fills `error` with a sentence.
  virtual bool CanWeigh() const { return false; }
  bool WeighPixel(int x, int y, quell::PixelWeights& weights, std::string& error);
  ///@}

  ///@{
  /// A frame taken in bands of rows, from the top down, one execution each: for sinks whose work can be put together
  /// (PipelineExecutor::SetBandRows). BeginBands says what the bands will cover; EndBands, after the last one, finishes
  /// it and throws quell::StageError where it cannot; DropBands leaves nothing of it.
  virtual bool TakesBands() const { return false; }
  virtual void BeginBands(const quell::Rect& region);
  virtual void EndBands() {}
  virtual void DropBands() {}
  ///@}

  /// Refuses what can be refused without input and without pixels: a view that the configuration lacks, a file name
  /// whose format nobody writes, a missing scene. Throws quell::StageError; called for every node before a pipeline
  /// runs.
  virtual void CheckSettings() {}

  /// Tells what is wrong with the stage's connections together: how many, whose arrays, with which attributes; what one
  /// connection alone can say (kinds, names) is checked already. Called when a pipeline is loaded, with what is known
  /// then, and before every execution, with everything; so Execute relies on it.
  virtual void CheckConnections(quell::ConnectionCheck&) const {}
  /// Somebody else has called CheckConnections and told its warnings; errors are found before every execution anyway.
  void SetConnectionsChecked(bool checked) { this->ConnectionsChecked = checked; }

  /// Array names the output may hold besides the described ones, known without executing (a reader's layers);
  /// throws quell::StageError when they cannot be known (missing file).
  virtual std::vector<quell::OutputArray> ListDynamicOutputs() { return {}; }

  /// A hash of all that is read through its files, those included that they refer to; empty where they refer to none.
  /// May read them; throws quell::StageError.
  virtual std::string HashOfContents() { return {}; }

  /// Files that the frame of this tick is read from, besides those that a property names as they are.
  virtual std::vector<std::string> ListSequenceFiles(int) const { return {}; }

  /// Pixels beyond the output region that `port` needs on every side.
  virtual int HaloFor(int port) const;
  /// Whether `port` is read at all when `asked` is wanted; a port that is not needed demands no array.
  virtual bool NeedsInput(int port, const quell::ArraySet& asked) const;
  /// Whether the stage itself makes the array (AddOutput) instead of passing it through. Default: those it describes.
  /// Further ones are still demanded of the first input, where they come from.
  virtual bool Makes(const std::string& array) const;

  /// Whether `port` may have another size than the stage's output (a reference image); then its whole extent is read
  /// and sizes are not compared.
  virtual bool AllowsOtherExtent(int port) const;

  /// Promises that Execute writes every component of every pixel of every output it makes; then outputs are not cleared
  /// before.
  virtual bool FillsOutputs() const { return false; }

  /// Largest part, in [0, 1], that what comes in through `port` keeps in the outputs while the other inputs share the
  /// rest: how fast a loop through this stage forgets. 1 - alpha for the history that is mixed with weight alpha; 1,
  /// the default, is right for filters (the past passes them whole) and the safe answer of a stage that does not know.
  virtual double HistoryWeight(int port) const;

  /// Stands in a set of names for "your first output": asked for where a stock VTK filter, which works on active
  /// scalars, lies in between.
  static const char* PrimaryArray();
  static vtkQuellArraySetKey* REQUESTED_ARRAYS();
  static vtkQuellArraySetKey* PROVIDED_ARRAYS();
  /// Marks the output information of a Quell stage or collector: it speaks for itself about arrays.
  static vtkInformationIntegerKey* IS_QUELL_STAGE();
  /// Union of what this pass asked of an output so far (x0, y0, x1, y1); there only while a vtkQuellCollector updates.
  /// VTK hands a producer each consumer's extent in turn, so a later, smaller request would replace an earlier one.
  static vtkInformationIntegerVectorKey* PASS_REGION();
  /// Sets UPDATE_EXTENT of a producer's output to `region`, united with what this pass asked before.
  static void RequestRegion(vtkInformation* info, const quell::Rect& region);

protected:
  vtkQuellStage();
  ~vtkQuellStage() override;

  /// Derived constructors call this once, after their members have their defaults.
  void InitializePorts();

  /// Sources only (no connected input): the frame's size; default (0, 0) = "from port 0".
  virtual void DescribeSource(int& width, int& height);

  /// Makes every wanted output array. Default: Prepare, then ExecuteTile over 64 x 64 tiles in parallel.
  virtual void Execute(quell::StageFrame& frame);
  /// Serial, before the tiles: tables, warnings.
  virtual void Prepare(quell::StageFrame& frame);
  /// Pure function of inputs and properties for the pixels of `tile`; called concurrently.
  virtual void ExecuteTile(const quell::StageFrame& frame, const quell::Rect& tile) const;

  /// WeighPixel's work; `frame` has the pixel as its region and no outputs. May throw.
  virtual void Weigh(quell::StageFrame& frame, quell::PixelWeights& weights);

  /// Runs `body` over the tiles of `region` in parallel, with progress and cancellation (throws
  /// StageError("cancelled")). Progress goes from `from` to `to`.
  void ForEachTile(const quell::Rect& region, int tileSize, const std::function<void(const quell::Rect&)>& body,
    double from = 0, double to = 1);
  bool IsCancelled() const { return this->Token && this->Token->IsCancelled(); }
  /// Stop sampling after the pass at work.
  bool IsFinishing() const { return this->Token && this->Token->IsFinishing(); }
  bool IsWatched() const { return this->Watched; }

  int FillInputPortInformation(int port, vtkInformation* info) override;
  int RequestInformation(vtkInformation*, vtkInformationVector**, vtkInformationVector*) override;
  int RequestUpdateExtent(vtkInformation*, vtkInformationVector**, vtkInformationVector*) override;
  int RequestData(vtkInformation*, vtkInformationVector**, vtkInformationVector*) override;

  quell::StageCounters Counters;
  std::vector<std::string> Warnings;
  std::string CountedWarning; ///< one of Warnings, or empty
  quell::Timeline Ticks;

private:
  friend class quell::StageFrame;
  int Fail(const std::string& text);
  quell::ArraySet WantedFrom(vtkInformation* outInfo) const;
  /// CheckConnections with what the inputs hold now; throws the first error.
  void CheckConnectionsNow(vtkInformationVector** inputVector);

  struct PortState;
  std::vector<std::unique_ptr<PortState>> Ports;
  quell::ArraySet AlwaysMake;
  std::shared_ptr<quell::CancelToken> Token;
  std::string ErrorText;
  bool Watched = false, ConnectionsChecked = false;

  vtkQuellStage(const vtkQuellStage&) = delete;
  void operator=(const vtkQuellStage&) = delete;
};

namespace quell
{
/// What a stage sees while it executes: its inputs and outputs as views in frame coordinates.
class VTKQUELLCORE_EXPORT StageFrame
{
public:
  Rect Region() const { return this->OutputRegion; } ///< pixels to compute
  Rect Whole() const { return this->WholeFrame; }    ///< the full frame
  int Tick() const { return this->FrameTick; }

  /// Connected images of a port (a delayed input counts 1 when it has history, else 0).
  int Connections(int port) const;
  bool Has(int port, int connection = 0) const { return connection < this->Connections(port); }
  /// The port's array; an absent view when the port is not connected, not needed or has no history yet. Throws
  /// StageError when the producer did not deliver the array, or it has another number of components than the port's
  /// kind.
  ImageIn Input(int port, int connection = 0) const;
  /// Same for the named array instead of the connection's own; it may have any number of components.
  ImageIn InputArray(int port, int connection, const std::string& name) const;
  vtkImageData* InputImage(int port, int connection = 0) const;
  FrameFacts Facts(int port = 0, int connection = 0) const;

  /// Is this output array wanted in this pass?
  bool Wants(const std::string& name) const { return this->Wanted.count(name) != 0; }
  const ArraySet& WantedArrays() const { return this->Wanted; }
  /// The view to fill, over Region(); an absent view when it is not wanted. Contents start at zero, unless the stage
  /// promised to fill them.
  ImageOut Output(const std::string& name);
  ImageOut Output(
    const std::string& name) const; ///< inside ExecuteTile: only arrays made before (all described ones are)
  /// Adds an array that the description does not list (a reader's layer).
  ImageOut AddOutput(const std::string& name, int components);
  /// Facts of the output frame; initialised from port 0's.
  FrameFacts OutputFacts;

private:
  friend class ::vtkQuellStage;
  vtkQuellStage* Stage = nullptr;
  vtkImageData* OutputImage = nullptr;
  Rect OutputRegion, WholeFrame;
  int FrameTick = 0;
  ArraySet Wanted;
  std::vector<std::vector<vtkSmartPointer<vtkImageData>>> Images;
  std::map<std::string, ImageOut> Views;
  mutable std::map<const void*, vtkSmartPointer<vtkFloatArray>> Converted;
};
}

/// In a stage's .cxx: the one static table, filled by `void X::Describe(quell::StageDescription& d)`.
#define QUELL_STAGE_DESCRIPTION(cls)                         \
  const quell::StageDescription& cls::GetDescription() const \
  {                                                          \
    static const quell::StageDescription table = []          \
    {                                                        \
      quell::StageDescription d;                             \
      d.Type = std::string(#cls).substr(8);                  \
      Describe(d);                                           \
      return d;                                              \
    }();                                                     \
    return table;                                            \
  }
/// In the class body.
#define QUELL_STAGE(cls)                                          \
  vtkTypeMacro(cls, vtkQuellStage);                               \
  static cls* New();                                              \
  const quell::StageDescription& GetDescription() const override; \
  static void Describe(quell::StageDescription& d)

#endif
