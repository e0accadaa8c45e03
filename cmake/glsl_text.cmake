# cmake -DIN=x.glsl -DOUT=x.inc -P glsl_text.cmake: preprocessed GLSL as a C++ raw string. What only glslc knows (its include
# extension, #line with file names) is dropped: OpenGL drivers refuse it.
file(READ ${IN} text)
string(REGEX REPLACE "\n#(line|extension GL_GOOGLE)[^\n]*" "" text "${text}")
string(REGEX REPLACE "\n[ \t\n]*\n" "\n" text "${text}")
file(WRITE ${OUT} "R\"glsl(${text})glsl\"\n")
