#include "shadow/options.h"
namespace gobo::shadowbench { int claims(Options) { return 1; } }
