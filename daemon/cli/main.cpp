#include "daemon/cli/command.h"

int main(int argc, char** argv) { return overfly::cli::run(argc, argv); }
