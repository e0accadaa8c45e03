// SPDX-License-Identifier: Apache-2.0
// The messages and gRPC.
#pragma once

#include <grpcpp/grpcpp.h>

#include "gobo/v1/jobs.grpc.pb.h"
#include "gobo/v1/service.grpc.pb.h"
#include "pch/messages.h"
