// SPDX-License-Identifier: Apache-2.0
// The rows of the format itself: https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html, chapter 5.
#include "import/gltf/schema.h"
#include "import/gltf/schema_shapes.h"

namespace gobo::gltf::shapes {
namespace {

constexpr std::string_view kComponentTypes = "5120 5121 5122 5123 5125 5126";

constexpr Field kAssetRows[] = {remark("copyright"), remark("generator"), text("version").required(), text("minVersion")};

constexpr Field kSparseIndicesRows[] = {index("bufferView", "bufferViews").required(), integer("byteOffset"),
                                        integer("componentType").oneOf("5121 5123 5125").required()};
constexpr Shape kSparseIndices{"accessor.sparse.indices", kSparseIndicesRows};
constexpr Field kSparseValuesRows[] = {index("bufferView", "bufferViews").required(), integer("byteOffset")};
constexpr Shape kSparseValues{"accessor.sparse.values", kSparseValuesRows};
constexpr Field kSparseRows[] = {integer("count", 1).required(), object("indices", kSparseIndices).required(), object("values", kSparseValues).required()};
constexpr Shape kSparse{"accessor.sparse", kSparseRows};
constexpr Field kAccessorRows[] = {
    index("bufferView", "bufferViews"),
    integer("byteOffset").needs("bufferView").warnsOfCompany(),
    integer("componentType").oneOf(kComponentTypes).required(),
    boolean("normalized"),
    integer("count", 1).required(),
    text("type").oneOf("SCALAR VEC2 VEC3 VEC4 MAT2 MAT3 MAT4").required(),
    numbers("max", 1).count(1, 16).onlyWarns(),  // bounds are compared with the data, which count
    numbers("min", 1).count(1, 16).onlyWarns(),
    object("sparse", kSparse),
    remark("name"),
};

constexpr Field kTargetRows[] = {index("node", "nodes"), text("path").oneOf("translation rotation scale weights pointer").required().warnsOfValue()};
constexpr Shape kTarget{"animation.channel.target", kTargetRows};
constexpr Field kChannelRows[] = {index("sampler", "samplers").required(), object("target", kTarget).required()};
constexpr Field kAnimationSamplerRows[] = {index("input", "accessors").required(), text("interpolation").oneOf("LINEAR STEP CUBICSPLINE").warnsOfValue(),
                                           index("output", "accessors").required()};
constexpr Shape kAnimationSampler{"animation.sampler", kAnimationSamplerRows};
constexpr Field kAnimationRows[] = {objects("samplers", kAnimationSampler).required(), objects("channels", kChannel).required(), remark("name")};

constexpr Field kBufferRows[] = {text("uri"), integer("byteLength", 1).required(), remark("name")};
constexpr Field kBufferViewRows[] = {
    index("buffer", "buffers").required(),
    integer("byteOffset"),
    integer("byteLength", 1).required(),
    integer("byteStride", 4, 252).multipleOf(4),
    integer("target").oneOf("34962 34963").onlyWarns(),
    remark("name"),
};

constexpr Field kOrthographicRows[] = {number("xmag").required(), number("ymag").required(), number("zfar").above(0).required(),
                                       number("znear").from(0).required()};
constexpr Shape kOrthographic{"camera.orthographic", kOrthographicRows};
constexpr Field kPerspectiveRows[] = {number("aspectRatio").above(0), number("yfov").above(0).required(), number("zfar").above(0),
                                      number("znear").above(0).required()};
constexpr Shape kPerspective{"camera.perspective", kPerspectiveRows};
constexpr Field kCameraRows[] = {object("orthographic", kOrthographic).excludes("perspective").warnsOfCompany(), object("perspective", kPerspective),
                                 text("type").oneOf("perspective orthographic").required(), remark("name")};

// A picture's kind is told by its bytes, so a missing or odd mimeType is a warning.
constexpr Field kImageRows[] = {text("uri").excludes("bufferView"), text("mimeType").oneOf("image/jpeg image/png image/webp image/ktx2").onlyWarns(),
                                index("bufferView", "bufferViews").needs("mimeType").warnsOfCompany(), remark("name")};

constexpr Field kOcclusionRows[] = {index("index", "textures").required(), integer("texCoord"), factor("strength")};
constexpr Shape kOcclusionInfo{"occlusionTextureInfo", kOcclusionRows};
constexpr Field kPbrRows[] = {factors("baseColorFactor", 4), object("baseColorTexture", kTextureInfo), factor("metallicFactor"), factor("roughnessFactor"),
                              object("metallicRoughnessTexture", kTextureInfo)};
constexpr Shape kPbr{"pbrMetallicRoughness", kPbrRows};
constexpr Field kMaterialRows[] = {
    object("pbrMetallicRoughness", kPbr),
    object("normalTexture", kNormalInfo),
    object("occlusionTexture", kOcclusionInfo),
    object("emissiveTexture", kTextureInfo),
    factors("emissiveFactor", 3),
    text("alphaMode").oneOf("OPAQUE MASK BLEND"),
    factor("alphaCutoff", 0, kLargest).needs("alphaMode").warnsOfCompany(),
    boolean("doubleSided"),
    remark("name"),
};

constexpr Field kPrimitiveRows[] = {indexMap("attributes", "accessors").required(),
                                    index("indices", "accessors"),
                                    index("material", "materials"),
                                    integer("mode", 0, 6),
                                    {.name = "targets", .kind = Kind::Objects, .shape = &kMorphTarget, .least = 1}};
constexpr Field kMeshRows[] = {objects("primitives", kPrimitive).required(), {.name = "weights", .kind = Kind::Numbers, .least = 1}, remark("name")};

constexpr Field kNodeRows[] = {
    index("camera", "cameras"),
    indices("children", "nodes"),
    index("skin", "skins").needs("mesh").warnsOfCompany(),
    numbers("matrix", 16).excludes("translation rotation scale"),
    index("mesh", "meshes"),
    numbers("rotation", 4).range(-1, 1).warnsOfValue(),
    numbers("scale", 3),
    numbers("translation", 3),
    Field{.name = "weights", .kind = Kind::Numbers, .least = 1}.needs("mesh").warnsOfCompany(),
    remark("name"),
};

// Unknown filters and wraps fall back to the defaults, as a later version of the format may add some.
constexpr Field kSamplerRows[] = {
    integer("magFilter").oneOf("9728 9729").warnsOfValue(), integer("minFilter").oneOf("9728 9729 9984 9985 9986 9987").warnsOfValue(),
    integer("wrapS").oneOf("33071 33648 10497").warnsOfValue(), integer("wrapT").oneOf("33071 33648 10497").warnsOfValue(), remark("name")};
constexpr Shape kSampler{"sampler", kSamplerRows};
constexpr Field kSceneRows[] = {indices("nodes", "nodes"), remark("name")};
constexpr Shape kScene{"scene", kSceneRows};
constexpr Field kSkinRows[] = {index("inverseBindMatrices", "accessors"), index("skeleton", "nodes"),
                               indices("joints", "nodes").required().warnsOfValue().refusesNone(), remark("name")};
constexpr Shape kSkin{"skin", kSkinRows};
// A picture that is not there leaves a scene that can be shown, whether its file is missing or its entry.
constexpr Field kTextureRows[] = {index("sampler", "samplers").warnsOfValue(), index("source", "images").warnsOfValue(), remark("name")};

constexpr Field kRootRows[] = {
    texts("extensionsUsed"),
    texts("extensionsRequired").needs("extensionsUsed").warnsOfCompany(),
    objects("accessors", kAccessor),
    objects("animations", kAnimation),
    object("asset", kAsset).required(),
    objects("buffers", kBuffer),
    objects("bufferViews", kBufferView),
    objects("cameras", kCamera),
    objects("images", kImage),
    objects("materials", kMaterial),
    objects("meshes", kMesh),
    objects("nodes", kNode),
    objects("samplers", kSampler),
    index("scene", "scenes"),
    objects("scenes", kScene),
    objects("skins", kSkin),
    objects("textures", kTexture),
};
constexpr Field kTextureInfoRows[] = {index("index", "textures").required(), integer("texCoord")};
constexpr Field kNormalRows[] = {index("index", "textures").required(), integer("texCoord"), number("scale")};

}  // namespace

constexpr Shape kAsset{"asset", kAssetRows};
constexpr Shape kAccessor{"accessor", kAccessorRows};
constexpr Shape kChannel{"animation.channel", kChannelRows};
constexpr Shape kAnimation{"animation", kAnimationRows};
constexpr Shape kBuffer{"buffer", kBufferRows};
constexpr Shape kBufferView{"bufferView", kBufferViewRows};
constexpr Shape kCamera{"camera", kCameraRows};
constexpr Shape kImage{"image", kImageRows};
constexpr Shape kTextureInfo{"textureInfo", kTextureInfoRows};
constexpr Shape kNormalInfo{"normalTextureInfo", kNormalRows};
constexpr Shape kMaterial{"material", kMaterialRows};
constexpr Shape kMorphTarget{"morph target", {}};
constexpr Shape kPrimitive{"mesh.primitive", kPrimitiveRows};
constexpr Shape kMesh{"mesh", kMeshRows};
constexpr Shape kNode{"node", kNodeRows};
constexpr Shape kTexture{"texture", kTextureRows};
constexpr Shape kRoot{"glTF", kRootRows};

}  // namespace gobo::gltf::shapes

namespace gobo::gltf {

const Shape& rootShape() { return shapes::kRoot; }
const Shape& morphTargetShape() { return shapes::kMorphTarget; }
bool isTextureInfo(const Shape& shape) { return &shape == &shapes::kTextureInfo || &shape == &shapes::kNormalInfo || &shape == &shapes::kOcclusionInfo; }

}  // namespace gobo::gltf
