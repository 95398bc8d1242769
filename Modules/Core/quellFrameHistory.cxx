// SPDX-License-Identifier: BSD-3-Clause
#include "quellFrameHistory.h"

#include "vtkDataArray.h"
#include "vtkFieldData.h"
#include "vtkImageData.h"
#include "vtkPointData.h"

namespace quell
{
vtkSmartPointer<vtkImageData> FrameHistory::Keep(vtkImageData* image, const ArraySet& arrays, vtkImageData* previous)
{
  if (previous)
  {
    bool same = true;
    for (const std::string& name : arrays)
      same = same && image->GetPointData()->GetArray(name.c_str()) == previous->GetPointData()->GetArray(name.c_str());
    if (same)
      return previous;
  }
  auto kept = vtkSmartPointer<vtkImageData>::New();
  kept->CopyStructure(image);
  for (const std::string& name : arrays)
    if (vtkDataArray* array = image->GetPointData()->GetArray(name.c_str()))
      kept->GetPointData()->AddArray(array);
  kept->GetFieldData()->ShallowCopy(image->GetFieldData());
  return kept;
}

void FrameHistory::Commit(int tick, Frame frame)
{
  this->Frames[tick] = std::move(frame);
  // Forget what is farthest from the frame just made: stepping back and forth around it stays possible.
  while (int(this->Frames.size()) > this->Kept)
  {
    const auto first = this->Frames.begin();
    const auto last = std::prev(this->Frames.end());
    this->Frames.erase(tick - first->first >= last->first - tick ? first : last);
  }
}

const FrameHistory::Frame* FrameHistory::FindFrame(int tick) const
{
  const auto frame = this->Frames.find(tick);
  return frame == this->Frames.end() ? nullptr : &frame->second;
}

vtkImageData* FrameHistory::Find(int tick, const std::string& producer) const
{
  const Frame* frame = this->FindFrame(tick);
  if (!frame)
    return nullptr;
  const auto image = frame->find(producer);
  return image == frame->end() ? nullptr : image->second.GetPointer();
}
}
