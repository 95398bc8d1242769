// SPDX-License-Identifier: BSD-3-Clause
#ifndef quellTradeoffReport_h
#define quellTradeoffReport_h

#include "quellTradeoff.h"
#include "vtkQuellTradeoffModule.h"

#include <string>

namespace quell
{
/// A line per setting and ledger row: what varies, milliseconds (median and quartiles), metrics with standard errors,
/// bias^2 and variance of relMSE, milliseconds of every node. RFC 4180.
VTKQUELLTRADEOFF_EXPORT std::string TradeoffCsv(const TradeoffReport& report);
/// All of it.
VTKQUELLTRADEOFF_EXPORT std::string TradeoffJson(const TradeoffReport& report);
/// One page that opens without a network: plot of error over time with the Pareto set, bias and variance, the table,
/// the ledger, pictures (`directory` holds them; they are made smaller and put into the page).
VTKQUELLTRADEOFF_EXPORT std::string TradeoffHtml(const TradeoffReport& report, const std::string& directory);
/// What a terminal shows: the Pareto set, the ledger, what was chosen.
VTKQUELLTRADEOFF_EXPORT std::string TradeoffText(const TradeoffReport& report);
}

#endif
