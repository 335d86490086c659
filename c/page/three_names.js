// What the page takes of three.js 0.187.0. In an empty folder, docs/crash-it/three.js is remade by
//   npm install three@0.187.0 esbuild@0.28.2
//   npx esbuild three_names.js --bundle --minify --format=iife --global-name=THREE --legal-comments=none --banner:js="/* three.js 0.187.0: LICENSE-three.txt */" --outfile=three.js
export {
  BoxGeometry, BufferAttribute, BufferGeometry, CanvasTexture, CapsuleGeometry, Color, ConeGeometry, CylinderGeometry,
  DirectionalLight, EdgesGeometry, Group, HemisphereLight, Line, LineBasicMaterial, LineSegments, Matrix4, Mesh,
  MeshBasicMaterial, MeshLambertMaterial, PerspectiveCamera, PlaneGeometry, Quaternion, Raycaster, RepeatWrapping,
  SRGBColorSpace, Scene, SphereGeometry, Vector3, WebGLRenderer,
} from "three";
