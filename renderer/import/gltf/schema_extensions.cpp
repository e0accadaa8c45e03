// SPDX-License-Identifier: Apache-2.0
// The rows of the extensions that are read: github.com/KhronosGroup/glTF, extensions/2.0.
#include "import/gltf/schema_shapes.h"

namespace gobo::gltf {
namespace {

using namespace shapes;
constexpr double kPi2 = 1.5707963267948968;

constexpr Field kSpotRows[] = {number("innerConeAngle").range(0, kPi2), number("outerConeAngle").range(0, kPi2).above(0)};
constexpr Shape kSpot{"KHR_lights_punctual spot", kSpotRows};
constexpr Field kLightRows[] = {factors("color", 3),      number("intensity").from(0),
                                object("spot", kSpot),    text("type").oneOf("directional point spot").required(),
                                number("range").above(0), remark("name")};
constexpr Shape kLight{"KHR_lights_punctual light", kLightRows};
constexpr Field kLightsRows[] = {objects("lights", kLight).required()};
constexpr Shape kLights{"KHR_lights_punctual", kLightsRows};
constexpr Field kLightUseRows[] = {index("light", "/extensions/KHR_lights_punctual/lights").required()};
constexpr Shape kLightUse{"KHR_lights_punctual of a node", kLightUseRows};

constexpr Field kIesProfileRows[] = {text("uri").excludes("bufferView"), index("bufferView", "bufferViews").needs("mimeType"),
                                     text("mimeType").oneOf("application/x-ies-lm-63").onlyWarns(), remark("name")};
constexpr Shape kIesProfile{"EXT_lights_ies light", kIesProfileRows};
constexpr Field kIesProfilesRows[] = {objects("lights", kIesProfile).required()};
constexpr Shape kIesProfiles{"EXT_lights_ies", kIesProfilesRows};
constexpr Field kIesUseRows[] = {index("light", "/extensions/EXT_lights_ies/lights").required(), number("multiplier").from(0), factors("color", 3)};
constexpr Shape kIesUse{"EXT_lights_ies of a node", kIesUseRows};

constexpr Field kAnisotropyRows[] = {factor("anisotropyStrength"), number("anisotropyRotation"), object("anisotropyTexture", kTextureInfo)};
constexpr Shape kAnisotropy{"KHR_materials_anisotropy", kAnisotropyRows};
constexpr Field kClearcoatRows[] = {factor("clearcoatFactor"), object("clearcoatTexture", kTextureInfo), factor("clearcoatRoughnessFactor"),
                                    object("clearcoatRoughnessTexture", kTextureInfo), object("clearcoatNormalTexture", kNormalInfo)};
constexpr Shape kClearcoat{"KHR_materials_clearcoat", kClearcoatRows};
constexpr Field kDiffuseTransmissionRows[] = {factor("diffuseTransmissionFactor"), object("diffuseTransmissionTexture", kTextureInfo),
                                              factors("diffuseTransmissionColorFactor", 3, kLargest), object("diffuseTransmissionColorTexture", kTextureInfo)};
constexpr Shape kDiffuseTransmission{"KHR_materials_diffuse_transmission", kDiffuseTransmissionRows};
constexpr Field kDispersionRows[] = {factor("dispersion", 0, kLargest)};
constexpr Shape kDispersion{"KHR_materials_dispersion", kDispersionRows};
constexpr Field kEmissiveStrengthRows[] = {number("emissiveStrength").from(0)};
constexpr Shape kEmissiveStrength{"KHR_materials_emissive_strength", kEmissiveStrengthRows};
constexpr Field kIorRows[] = {number("ior").from(0)};  // 0 or at least 1: a rule
constexpr Shape kIor{"KHR_materials_ior", kIorRows};
constexpr Field kIridescenceRows[] = {factor("iridescenceFactor"),
                                      object("iridescenceTexture", kTextureInfo),
                                      factor("iridescenceIor", 1, kLargest),
                                      factor("iridescenceThicknessMinimum", 0, kLargest),
                                      factor("iridescenceThicknessMaximum", 0, kLargest),
                                      object("iridescenceThicknessTexture", kTextureInfo)};
constexpr Shape kIridescence{"KHR_materials_iridescence", kIridescenceRows};
constexpr Field kGlossyRows[] = {factors("diffuseFactor", 4), object("diffuseTexture", kTextureInfo), factors("specularFactor", 3), factor("glossinessFactor"),
                                 object("specularGlossinessTexture", kTextureInfo)};
constexpr Shape kGlossy{"KHR_materials_pbrSpecularGlossiness", kGlossyRows};
constexpr Field kSheenRows[] = {factors("sheenColorFactor", 3), object("sheenColorTexture", kTextureInfo), factor("sheenRoughnessFactor"),
                                object("sheenRoughnessTexture", kTextureInfo)};
constexpr Shape kSheen{"KHR_materials_sheen", kSheenRows};
constexpr Field kSpecularRows[] = {factor("specularFactor"), object("specularTexture", kTextureInfo), factors("specularColorFactor", 3, kLargest),
                                   object("specularColorTexture", kTextureInfo)};
constexpr Shape kSpecular{"KHR_materials_specular", kSpecularRows};
constexpr Field kTransmissionRows[] = {factor("transmissionFactor"), object("transmissionTexture", kTextureInfo)};
constexpr Shape kTransmission{"KHR_materials_transmission", kTransmissionRows};
constexpr Shape kUnlit{"KHR_materials_unlit", {}};
constexpr Field kVariantRows[] = {text("name").required()};
constexpr Shape kVariant{"KHR_materials_variants variant", kVariantRows};
constexpr Field kVariantsRows[] = {objects("variants", kVariant).required()};
constexpr Shape kVariants{"KHR_materials_variants", kVariantsRows};
constexpr Field kMappingRows[] = {indices("variants", "/extensions/KHR_materials_variants/variants").required().warnsOfValue(),
                                  index("material", "materials").required(), remark("name")};
constexpr Shape kMapping{"KHR_materials_variants mapping", kMappingRows};
constexpr Field kMappingsRows[] = {objects("mappings", kMapping).required()};
constexpr Shape kMappings{"KHR_materials_variants of a primitive", kMappingsRows};
constexpr Field kVolumeRows[] = {factor("thicknessFactor", 0, kLargest), object("thicknessTexture", kTextureInfo),
                                 number("attenuationDistance").above(0).warnsOfValue(), factors("attenuationColor", 3)};
constexpr Shape kVolume{"KHR_materials_volume", kVolumeRows};
constexpr Field kScatterRows[] = {factors("multiscatterColor", 3), factor("scatterAnisotropy", -1, 1)};
constexpr Shape kScatter{"KHR_materials_volume_scatter", kScatterRows};

constexpr Field kTransformRows[] = {numbers("offset", 2), number("rotation"), numbers("scale", 2), integer("texCoord")};
constexpr Shape kTransform{"KHR_texture_transform", kTransformRows};
constexpr Field kPictureRows[] = {index("source", "images").warnsOfValue()};
constexpr Shape kWebp{"EXT_texture_webp", kPictureRows};
constexpr Shape kBasis{"KHR_texture_basisu", kPictureRows};

constexpr Field kDracoRows[] = {index("bufferView", "bufferViews").required(), indexMap("attributes", "").required()};
constexpr Shape kDraco{"KHR_draco_mesh_compression", kDracoRows};
constexpr Field kMeshoptRows[] = {index("buffer", "buffers").required(),
                                  integer("byteOffset"),
                                  integer("byteLength", 1).required(),
                                  integer("byteStride", 1, 256).required(),
                                  integer("count", 1).required(),
                                  text("mode").oneOf("ATTRIBUTES TRIANGLES INDICES").required(),
                                  text("filter").oneOf("NONE OCTAHEDRAL QUATERNION EXPONENTIAL")};
constexpr Shape kMeshopt{"EXT_meshopt_compression", kMeshoptRows};
constexpr Field kMeshoptBufferRows[] = {boolean("fallback")};
constexpr Shape kMeshoptBuffer{"EXT_meshopt_compression of a buffer", kMeshoptBufferRows};
constexpr Field kInstancingRows[] = {indexMap("attributes", "accessors").required()};
constexpr Shape kInstancing{"EXT_mesh_gpu_instancing", kInstancingRows};

constexpr ExtensionRow kRows[] = {
    {"KHR_lights_punctual", &kRoot, &kLights},
    {"KHR_lights_punctual", &kNode, &kLightUse},
    {"EXT_lights_ies", &kRoot, &kIesProfiles},
    {"EXT_lights_ies", &kNode, &kIesUse},
    {"KHR_materials_anisotropy", &kMaterial, &kAnisotropy},
    {"KHR_materials_clearcoat", &kMaterial, &kClearcoat},
    {"KHR_materials_diffuse_transmission", &kMaterial, &kDiffuseTransmission},
    {"KHR_materials_dispersion", &kMaterial, &kDispersion},
    {"KHR_materials_emissive_strength", &kMaterial, &kEmissiveStrength},
    {"KHR_materials_ior", &kMaterial, &kIor},
    {"KHR_materials_iridescence", &kMaterial, &kIridescence},
    {"KHR_materials_pbrSpecularGlossiness", &kMaterial, &kGlossy},
    {"KHR_materials_sheen", &kMaterial, &kSheen},
    {"KHR_materials_specular", &kMaterial, &kSpecular},
    {"KHR_materials_transmission", &kMaterial, &kTransmission},
    {"KHR_materials_unlit", &kMaterial, &kUnlit},
    {"KHR_materials_variants", &kRoot, &kVariants},
    {"KHR_materials_variants", &kPrimitive, &kMappings},
    {"KHR_materials_volume", &kMaterial, &kVolume},
    {"KHR_materials_volume_scatter", &kMaterial, &kScatter},
    {"KHR_texture_transform", &kTextureInfo, &kTransform},
    {"KHR_texture_basisu", &kTexture, &kBasis},
    {"EXT_texture_webp", &kTexture, &kWebp},
    {"KHR_draco_mesh_compression", &kPrimitive, &kDraco},
    {"EXT_meshopt_compression", &kBufferView, &kMeshopt},
    {"EXT_meshopt_compression", &kBuffer, &kMeshoptBuffer},
    {"EXT_mesh_gpu_instancing", &kNode, &kInstancing},
};

}  // namespace

std::span<const ExtensionRow> extensionRows() { return kRows; }

}  // namespace gobo::gltf
