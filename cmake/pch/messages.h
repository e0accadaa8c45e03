// SPDX-License-Identifier: Apache-2.0
// The standard set and the protocol's messages.
#pragma once

#include "gobo/v1/render.pb.h"
#include "gobo/v1/service.pb.h"
#include "pch/standard.h"
