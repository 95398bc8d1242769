// SPDX-License-Identifier: BSD-3-Clause
#include "quellTemporaryFile.h"

#include <atomic>
#include <cerrno>
#include <cstdio>
#include <fcntl.h>
#include <filesystem>
#include <sys/stat.h>
#include <unistd.h>

namespace quell
{
TemporaryFile::TemporaryFile(const std::string& target)
  : Target(target)
{
  struct stat there;
  const bool replaces = lstat(target.c_str(), &there) == 0 && !S_ISLNK(there.st_mode) && !S_ISDIR(there.st_mode);
  const mode_t rights = replaces ? there.st_mode & 0777 : 0666;
  if (replaces)
  {
    this->Failure = !S_ISREG(there.st_mode) ? EEXIST : access(target.c_str(), W_OK) != 0 ? errno : 0;
  }
  static std::atomic<unsigned> counter{ 0 };
  const std::filesystem::path path(target);
  const std::string name = "." + path.filename().string().substr(0, 200) + "." + std::to_string(getpid()) + "-";
  // A process of the same number may have been killed here, as where every container's is 1.
  for (int attempt = 0; attempt < 1000 && !this->Failure && this->File < 0; ++attempt)
  {
    this->Name = (path.parent_path() / (name + std::to_string(counter++) + ".part")).string();
    this->File = open(this->Name.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, rights);
    if (this->File < 0 && errno != EEXIST)
    {
      this->Failure = errno;
    }
  }
  if (this->File < 0)
  {
    this->Failure = this->Failure ? this->Failure : EEXIST;
    this->Done = true; // what is there under this name is not ours
  }
  else if (replaces && fchmod(this->File, rights) != 0) // the umask took some away
  {
    this->Failure = errno;
  }
}

TemporaryFile::~TemporaryFile()
{
  if (this->File >= 0)
  {
    close(this->File);
  }
  if (!this->Done)
  {
    unlink(this->Name.c_str());
  }
}

int TemporaryFile::Write(const void* data, std::size_t bytes)
{
  const std::size_t buffer = 1 << 16;
  const char* const from = static_cast<const char*>(data);
  if (this->Waiting.size() + bytes > buffer)
  {
    this->Send(this->Waiting.data(), this->Waiting.size());
    this->Waiting.clear();
  }
  if (bytes > buffer)
  {
    this->Send(from, bytes);
  }
  else
  {
    this->Waiting.append(from, bytes);
  }
  return this->Failure;
}

void TemporaryFile::Send(const char* data, std::size_t bytes)
{
  while (bytes > 0 && !this->Failure)
  {
    const ssize_t sent = write(this->File, data, bytes);
    if (sent > 0)
    {
      data += sent;
      bytes -= std::size_t(sent);
    }
    else if (sent == 0 || errno != EINTR)
    {
      this->Failure = sent == 0 ? ENOSPC : errno;
    }
  }
}

int TemporaryFile::Close()
{
  this->Send(this->Waiting.data(), this->Waiting.size());
  this->Waiting.clear();
  if (this->File >= 0)
  {
    const bool closed = close(this->File) == 0;
    this->File = -1;
    if (!closed && !this->Failure)
    {
      this->Failure = errno;
    }
  }
  return this->Failure;
}

int TemporaryFile::Rename()
{
  if (!this->Close() && !this->Done)
  {
    if (std::rename(this->Name.c_str(), this->Target.c_str()) != 0)
    {
      this->Failure = errno;
    }
    else
    {
      this->Done = true;
    }
  }
  return this->Failure;
}
}
